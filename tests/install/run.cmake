# Installs slf into a prefix of its own, builds the example against it and runs it:
#   cmake -D BUILD=slf's build folder -D SOURCE=slf's sources -D WORK=scratch folder
#         -D COMPILER=c++ -P run.cmake
function(run)
  execute_process(COMMAND ${ARGV} COMMAND_ERROR_IS_FATAL ANY OUTPUT_VARIABLE output)
  message("${output}")
  set(output "${output}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE ${WORK})
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/prefix)
run(${WORK}/prefix/bin/slf --version)
run(${WORK}/prefix/bin/slf build scene:balls -o ${WORK}/balls.slf --entry 2 --exit 8 --levels 2)
run(${CMAKE_COMMAND} -G Ninja -S ${SOURCE}/examples -B ${WORK}/build
    -D CMAKE_PREFIX_PATH=${WORK}/prefix -D CMAKE_CXX_COMPILER=${COMPILER} -D CMAKE_BUILD_TYPE=Debug
    "-DCMAKE_CXX_FLAGS=${FLAGS}")
run(${CMAKE_COMMAND} --build ${WORK}/build)
run(${WORK}/build/views ${WORK}/balls.slf ${WORK}/view.png)
if(NOT output MATCHES "frame 9: 100 % at full level" OR NOT EXISTS ${WORK}/view.png)
  message(FATAL_ERROR "the example did not draw what it should")
endif()
