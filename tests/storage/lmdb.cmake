# LMDB 1.x makes other files than 0.9, so slf is not configured for it, and does not compile with it:
#   cmake -D SOURCE=slf's sources -D WORK=scratch folder -D COMPILER=c++ -P lmdb.cmake
file(REMOVE_RECURSE ${WORK})
file(WRITE ${WORK}/CMakeLists.txt "cmake_minimum_required(VERSION 3.22)
project(configured CXX)
include(${SOURCE}/cmake/SlfDependencies.cmake)
")
function(configure version expected)
  file(WRITE ${WORK}/lmdb.pc "Name: lmdb\nDescription: stub\nVersion: ${version}\n")
  execute_process(
    COMMAND ${CMAKE_COMMAND} -E env PKG_CONFIG_PATH=${WORK}
            ${CMAKE_COMMAND} -S ${WORK} -B ${WORK}/build -D CMAKE_CXX_COMPILER=${COMPILER}
    RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
  file(REMOVE_RECURSE ${WORK}/build)
  if(NOT output MATCHES "${expected}")
    message(FATAL_ERROR "LMDB ${version}: expected '${expected}', found:\n${output}")
  endif()
endfunction()
configure(0.9.33 "Configuring done")
configure(1.0.0 "lmdb<1.*not found|lmdb < 1")

# The header may be another one than pkg-config says.
file(WRITE ${WORK}/lmdb.h "#include_next <lmdb.h>
#undef MDB_VERSION_MAJOR
#define MDB_VERSION_MAJOR 1
")
execute_process(
  COMMAND ${COMPILER} -std=c++20 -fsyntax-only -I${WORK} -I${SOURCE} -I${SOURCE}/include
          ${SOURCE}/storage/environment.cc
  RESULT_VARIABLE status ERROR_VARIABLE output)
if(status EQUAL 0 OR NOT output MATCHES "build with 0.9")
  message(FATAL_ERROR "environment.cc compiles with LMDB 1.0: ${output}")
endif()
