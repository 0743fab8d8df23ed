# slf.pc, for programs that are not built with CMake.
set(ours)
set(needs)
foreach(library IN LISTS slf_libraries)
  list(PREPEND ours -lslf_${library})  # users before what they use
  list(APPEND needs ${slf_${library}_needs})
endforeach()
list(REMOVE_DUPLICATES needs)
slf_cells(requires pc ${needs})
set(libs ${requires})
list(FILTER requires EXCLUDE REGEX "^-")
list(FILTER libs INCLUDE REGEX "^-")
list(JOIN ours " " ours)
list(JOIN libs " " libs)
list(JOIN requires ", " requires)
# A program that links static libraries links what they use, too.
if(BUILD_SHARED_LIBS)
  set(lines "Requires.private: ${requires}\nLibs: -L\${libdir} ${ours}\nLibs.private: ${libs}")
else()
  set(lines "Requires: ${requires}\nLibs: -L\${libdir} ${ours} ${libs}")
endif()
# Relative to the file itself, so that the tree may be installed anywhere.
file(RELATIVE_PATH up /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
file(CONFIGURE OUTPUT slf.pc @ONLY CONTENT
"prefix=\${pcfiledir}/${up}.
libdir=\${prefix}/${CMAKE_INSTALL_LIBDIR}
includedir=\${prefix}/${CMAKE_INSTALL_INCLUDEDIR}

Name: slf
Description: ${PROJECT_DESCRIPTION}
Version: ${PROJECT_VERSION}
${lines}
Cflags: -I\${includedir}
")
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/slf.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
