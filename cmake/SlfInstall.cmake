# The install components: `program` is the program with its manual; `development` is the libraries
# with their headers and package files. Include this before any target is defined.
set(CMAKE_INSTALL_DEFAULT_COMPONENT_NAME development)

# A program finds the modules and libraries that were built or installed with it, wherever that is.
option(BUILD_SHARED_LIBS "Build shared libraries" OFF)
set(CMAKE_BUILD_RPATH ${PROJECT_BINARY_DIR}/modules)
set(CMAKE_INSTALL_RPATH $ORIGIN/../${CMAKE_INSTALL_LIBDIR}/slf)
if(BUILD_SHARED_LIBS)
  list(APPEND CMAKE_INSTALL_RPATH $ORIGIN $ORIGIN/slf $ORIGIN/../${CMAKE_INSTALL_LIBDIR})
endif()
