# Debian packages: `slf`, the program with its manual and completion; `libslf-dev`, static
# libraries, headers and package files; `python3-slf`, the Python package, if it is built.
# scripts/package makes them and tries them in a clean system.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME slf)
set(CPACK_PACKAGE_VENDOR "slf authors")
set(CPACK_PACKAGE_CONTACT "slf authors <slf@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_VERBATIM_VARIABLES ON)

set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL program development)
if(TARGET slf_python)
  list(APPEND CPACK_COMPONENTS_ALL python)
endif()
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)

set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME slf)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
# Loaded when it is first used, so dpkg-shlibdeps does not find it.
set(CPACK_DEBIAN_PROGRAM_PACKAGE_DEPENDS "libcurl4 (>= 7.85)")
set(CPACK_COMPONENT_PROGRAM_DESCRIPTION
  "Build, store and render sphere light fields
 A sphere light field stores the colour of every ray that crosses a sphere
 around an object, so that any view from outside is a look-up. This is the
 command slf, which builds such fields from CT, MRI and other volumes and
 draws views of them within a given amount of memory.")

set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libslf-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(needs)
foreach(library IN LISTS slf_libraries)
  list(APPEND needs ${slf_${library}_needs})
endforeach()
slf_cells(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS debian ${needs})
list(APPEND CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS pkg-config slf ${loaded})
list(REMOVE_DUPLICATES CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS)
list(JOIN CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS ", " CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS)
set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION
  "Sphere light fields: static libraries and headers
 Libraries that open, render and build sphere light fields, with their
 headers and files for CMake and pkg-config.")

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-slf)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "${SLF_PYTHON_DEPENDS}" ${loaded})
list(JOIN CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS ", " CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS)
set(CPACK_COMPONENT_PYTHON_DESCRIPTION
  "Sphere light fields from Python
 Builds fields from arrays, images and functions of rays, draws views of them
 as arrays, and shows them in notebooks.")

if(BUILD_SHARED_LIBS)
  # The program needs the libraries: one package of everything.
  set(CPACK_DEB_COMPONENT_INSTALL OFF)
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
  set(CPACK_DEBIAN_PACKAGE_DEPENDS ${loaded})
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${PROJECT_BINARY_DIR})
  set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
endif()

install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} RENAME copyright
        COMPONENT program)
include(CPack)
