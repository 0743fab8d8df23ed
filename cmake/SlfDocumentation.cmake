# The target `doc`: the public headers as HTML, in doc/html of the build folder. Doxygen's warnings
# are errors, so that headers and documentation stay consistent.
find_package(Doxygen QUIET)
if(NOT DOXYGEN_FOUND)
  return()
endif()
configure_file(${PROJECT_SOURCE_DIR}/doc/Doxyfile.in ${PROJECT_BINARY_DIR}/doc/Doxyfile @ONLY)
add_custom_target(doc
  COMMAND Doxygen::doxygen ${PROJECT_BINARY_DIR}/doc/Doxyfile
  WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
  COMMENT "Documenting the public headers in doc/html" VERBATIM)
