# Where what is installed belongs: the program with its manual is one component, the libraries, their
# headers and package files are the other. Included before any target is made.
set(CMAKE_INSTALL_DEFAULT_COMPONENT_NAME development)

option(BUILD_SHARED_LIBS "Build shared libraries" OFF)
if(BUILD_SHARED_LIBS)
  # An installed program finds the libraries that were installed with it, wherever that is.
  set(CMAKE_INSTALL_RPATH "$ORIGIN;$ORIGIN/../${CMAKE_INSTALL_LIBDIR}")
endif()
