# Installs slf into a prefix of its own, builds the examples against it and runs them, once found by
# CMake and once by pkg-config:
#   cmake -D BUILD=slf's build folder -D SOURCE=slf's sources -D WORK=scratch folder
#         -D COMPILER=c++ -D LIBDIR=lib -P run.cmake
function(run)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE status OUTPUT_VARIABLE output)
  message("${output}")
  if(NOT status EQUAL 0)
    list(JOIN ARGV " " line)
    message(FATAL_ERROR "failed: ${line}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE ${WORK})
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/prefix)
run(${WORK}/prefix/bin/slf --version)
run(${WORK}/prefix/bin/slf build scene:balls -o ${WORK}/balls.slf --entry 2 --exit 8 --levels 2)

# GDCM is loaded for compressed DICOM only, with a module that the program finds beside itself.
run(ldd ${WORK}/prefix/bin/slf)
if(output MATCHES "libgdcm")
  message(FATAL_ERROR "slf loads GDCM when it starts")
endif()
set(compressed ${WORK}/prefix/bin/slf raycast ${SOURCE}/tests/install/rle
    -o ${WORK}/rle.png -f --size 16)
run(${compressed})
file(REMOVE ${WORK}/prefix/${LIBDIR}/slf/slf_gdcm.so)
# Tests under a sanitizer have a path to modules in the environment.
execute_process(COMMAND ${CMAKE_COMMAND} -E env --unset=LD_LIBRARY_PATH ${compressed}
  RESULT_VARIABLE status ERROR_VARIABLE output)
if(NOT status EQUAL 5 OR NOT output MATCHES "slf_gdcm.so")
  message(FATAL_ERROR "without its module, slf ends with ${status}: ${output}")
endif()

run(${CMAKE_COMMAND} -G Ninja -S ${SOURCE}/examples -B ${WORK}/build
    -D CMAKE_PREFIX_PATH=${WORK}/prefix -D CMAKE_CXX_COMPILER=${COMPILER} -D CMAKE_BUILD_TYPE=Debug
    "-DCMAKE_CXX_FLAGS=${FLAGS}")
run(${CMAKE_COMMAND} --build ${WORK}/build)
run(${WORK}/build/views ${WORK}/balls.slf ${WORK}/view.png)
if(NOT output MATCHES "frame 9: 100 % at full level" OR NOT EXISTS ${WORK}/view.png)
  message(FATAL_ERROR "the example did not draw what it should")
endif()

# A volume of 8³ voxels; its content does not matter.
string(REPEAT "0123456789abcdef" 32 voxels)
file(WRITE ${WORK}/block.nrrd "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n\n${voxels}")
run(${WORK}/build/lit ${WORK}/block.nrrd micro-ct overcast ${WORK}/lit.exr)
if(NOT EXISTS ${WORK}/lit.exr)
  message(FATAL_ERROR "the example of light drew nothing")
endif()

# A scene of one's own.
run(${WORK}/build/scene ${WORK}/ball.slf)
run(${WORK}/prefix/bin/slf render ${WORK}/ball.slf -o ${WORK}/ball.png)
if(NOT EXISTS ${WORK}/ball.png)
  message(FATAL_ERROR "the example of a scene built no field")
endif()

# A program that only renders loads nothing for volumes, picture files or writing.
run(${WORK}/build/mean_color ${WORK}/balls.slf)
run(ldd ${WORK}/build/mean_color)
if(output MATCHES "(lib(gdcm|OpenEXR|webp|lmdb|png|curl)[^]]*)")
  message(FATAL_ERROR "mean_color links slf::core alone and yet loads ${CMAKE_MATCH_1}")
endif()
if(NOT output MATCHES "libzstd")
  message(FATAL_ERROR "ldd did not list what mean_color loads")
endif()

# Everything installed stands under slf/, and no header needs a library that is not in the API.
file(GLOB_RECURSE headers RELATIVE ${WORK}/prefix/include ${WORK}/prefix/include/*)
foreach(header IN LISTS headers)
  if(NOT header MATCHES "^slf/[a-z_]+\\.h$")
    message(FATAL_ERROR "${header} is installed, and no public header")
  endif()
  file(READ ${WORK}/prefix/include/${header} text)
  if(text MATCHES "#include [<\"](nlohmann|hwy|lmdb|field/|codec/|storage/|base/)[^>\"]*")
    message(FATAL_ERROR "${header}: ${CMAKE_MATCH_0}")
  endif()
endforeach()

execute_process(
  COMMAND ${CMAKE_COMMAND} -E env PKG_CONFIG_PATH=${WORK}/prefix/${LIBDIR}/pkgconfig
          pkg-config --cflags --libs slf
  COMMAND_ERROR_IS_FATAL ANY OUTPUT_VARIABLE flags OUTPUT_STRIP_TRAILING_WHITESPACE)
separate_arguments(flags UNIX_COMMAND "${FLAGS} ${flags}")
run(${COMPILER} -std=c++20 ${SOURCE}/examples/picture.cc -o ${WORK}/picture ${flags}
    -Wl,-rpath,${WORK}/prefix/${LIBDIR})
run(${WORK}/picture ${WORK}/balls.slf ${WORK}/picture.png)
if(NOT EXISTS ${WORK}/picture.png)
  message(FATAL_ERROR "the program that pkg-config found the libraries for drew nothing")
endif()
