# The libraries that are installed, and the rooms that each holds. A program that stores, repacks,
# serves or draws fields links none of slf::source.
slf_library(core ROOMS base storage codec geometry predict reveal scene field tiles
  render)
slf_library(image ROOMS image LINKS core)
slf_library(write ROOMS storage_writer inspect write LINKS image)
slf_library(source LINKS write
  ROOMS documents volume transfer medium light raycast analytic mesh pictures recipe measure)
slf_library(remote ROOMS remote LINKS core)

# All of them, for programs that do not choose.
add_library(slf_slf INTERFACE)
add_library(slf::slf ALIAS slf_slf)
set_target_properties(slf_slf PROPERTIES EXPORT_NAME slf)
foreach(library IN LISTS slf_libraries)
  target_link_libraries(slf_slf INTERFACE slf::${library})
endforeach()
install(TARGETS slf_slf EXPORT slf-targets)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/slf DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})

# What find_package(slf) looks for (slf-config.cmake.in).
set(slf_needs)
foreach(library IN LISTS slf_libraries)
  string(APPEND slf_needs "set(slf_needs_${library}")
  foreach(name IN LISTS slf_${library}_needs)
    if(NOT slf_${name}_link STREQUAL "headers")
      string(TOUPPER ${name} prefix)
      string(REGEX REPLACE "^pkg:" "pkg:${prefix}:" need ${slf_${name}_found_by})
      string(APPEND slf_needs " ${need}")
    endif()
  endforeach()
  string(APPEND slf_needs ")\n")
endforeach()
configure_package_config_file(cmake/slf-config.cmake.in slf-config.cmake
                              INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/slf)
