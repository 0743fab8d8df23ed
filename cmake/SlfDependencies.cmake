# Finds what cmake/dependencies.txt lists. For each NAME: slf_NAME_found_by, _target, _pc, _link and
# _debian.
set(slf_dependencies)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS
             ${CMAKE_CURRENT_LIST_DIR}/dependencies.txt)
file(STRINGS ${CMAKE_CURRENT_LIST_DIR}/dependencies.txt rows REGEX "^[a-z]")
foreach(row IN LISTS rows)
  string(REGEX MATCHALL "[^ ]+" cells "${row}")
  list(POP_FRONT cells name)
  list(APPEND slf_dependencies ${name})
  foreach(column found_by target pc link debian)
    list(POP_FRONT cells slf_${name}_${column})
  endforeach()
endforeach()

find_package(PkgConfig REQUIRED)

foreach(name IN LISTS slf_dependencies)
  if(slf_${name}_found_by MATCHES "^pkg:(.*)")
    string(REPLACE "," ";" modules ${CMAKE_MATCH_1})
    string(TOUPPER ${name} prefix)
    pkg_check_modules(${prefix} REQUIRED IMPORTED_TARGET ${modules})
  elseif(NOT slf_${name}_found_by STREQUAL "-")
    string(REPLACE "," ";" package ${slf_${name}_found_by})
    find_package(${package} REQUIRED)
  endif()
endforeach()

# slf_cells(OUT COLUMN NAMES...): what the rows of the names hold in a column, but for "-".
function(slf_cells out column)
  set(cells)
  foreach(name IN LISTS ARGN)
    list(APPEND cells ${slf_${name}_${column}})
  endforeach()
  list(REMOVE_ITEM cells -)
  set(${out} ${cells} PARENT_SCOPE)
endfunction()
