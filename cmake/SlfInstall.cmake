# The install components: `program` is the program with its manual; `development` is the libraries
# with their headers and package files. Include this before any target is defined.
set(CMAKE_INSTALL_DEFAULT_COMPONENT_NAME development)

option(BUILD_SHARED_LIBS "Build shared libraries" OFF)
if(BUILD_SHARED_LIBS)
  # An installed program finds the libraries that were installed with it, wherever that is.
  set(CMAKE_INSTALL_RPATH "$ORIGIN;$ORIGIN/../${CMAKE_INSTALL_LIBDIR}")
endif()
