# The target `doc`: the public headers as HTML, in doc/html of the build folder. What Doxygen warns
# about is an error, so that headers and their documentation cannot part.
find_package(Doxygen QUIET)
if(NOT DOXYGEN_FOUND)
  return()
endif()
configure_file(${PROJECT_SOURCE_DIR}/doc/Doxyfile.in ${PROJECT_BINARY_DIR}/doc/Doxyfile @ONLY)
add_custom_target(doc
  COMMAND Doxygen::doxygen ${PROJECT_BINARY_DIR}/doc/Doxyfile
  WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
  COMMENT "Documenting the public headers in doc/html" VERBATIM)
