# slf_wasm_module(OUTPUT [FLAGS FLAG...] SOURCES SOURCE...): a WebAssembly module of sources of this
# project, compiled by clang without Emscripten. SLF_WASM is set if the tools are installed: on Debian 12 these are lld,
# wasi-libc, libc++-14-dev-wasm32, libc++abi-14-dev-wasm32, libclang-rt-14-dev-wasm32 and esbuild.

find_program(SLF_WASM_COMPILER NAMES clang++-14 clang++)
find_program(SLF_ESBUILD esbuild)  # bundles the scripts that use the module
set(wasm_flags --target=wasm32-wasi -O2 -std=c++20 -fno-exceptions -msimd128 -DNDEBUG
  -DXXH_INLINE_ALL -DJSON_HAS_FILESYSTEM=0 -DJSON_HAS_EXPERIMENTAL_FILESYSTEM=0
  -ffp-contract=off -Wall -Wextra -Wno-unused-command-line-argument)
set(wasm_link_flags -mexec-model=reactor -Wl,--gc-sections,--strip-all -Wl,-z,stack-size=1048576)

set(SLF_WASM OFF CACHE INTERNAL "Whether WebAssembly can be made")
if(SLF_WASM_COMPILER AND SLF_ESBUILD)
  file(WRITE ${CMAKE_BINARY_DIR}/wasm/probe.cc
    "#include <sstream>\nextern \"C\" int probe() { std::ostringstream s; s << 1; return (int)s.str().size(); }\n")
  execute_process(
    COMMAND ${SLF_WASM_COMPILER} ${wasm_flags} ${wasm_link_flags} -Wl,--export=probe
      ${CMAKE_BINARY_DIR}/wasm/probe.cc -o ${CMAKE_BINARY_DIR}/wasm/probe.wasm
    RESULT_VARIABLE probe_failed OUTPUT_QUIET ERROR_VARIABLE probe_said)
  if(NOT probe_failed)
    set(SLF_WASM ON CACHE INTERNAL "Whether WebAssembly can be made")
  endif()
endif()
if(NOT SLF_WASM)
  message(STATUS "slf view and slf export are built without their page: clang cannot make "
    "WebAssembly here, or esbuild is missing. scripts/install-packages installs what it needs.")
endif()

function(slf_wasm_module output)
  cmake_parse_arguments(PARSE_ARGV 1 module "" "" "FLAGS;SOURCES")
  get_filename_component(name ${output} NAME_WE)
  set(folder ${CMAKE_BINARY_DIR}/wasm/${name})
  # The headers of libraries that need no compiled part; /usr/include has those of another C
  # library.
  set(include ${CMAKE_BINARY_DIR}/wasm/include)
  file(MAKE_DIRECTORY ${include})
  foreach(header tl/expected.hpp glm/glm.hpp nlohmann/json.hpp hwy/highway.h xxhash.h)
    find_path(place ${header} NO_CACHE REQUIRED)
    string(REGEX REPLACE "/.*" "" top ${header})
    file(CREATE_LINK ${place}/${top} ${include}/${top} SYMBOLIC)
    unset(place)
  endforeach()
  # One translation unit, which takes a third of the time of single ones; but Highway includes
  # kernels again for each instruction set.
  set(unit ${folder}/unit.cc)
  set(sources ${unit})
  set(includes)
  foreach(source ${module_SOURCES})
    set(source ${PROJECT_SOURCE_DIR}/${source})
    file(STRINGS ${source} is_kernel REGEX "hwy/foreach_target" LIMIT_COUNT 1)
    if(is_kernel)
      list(APPEND sources ${source})
    else()
      string(APPEND includes "#include \"${source}\"\n")
    endif()
  endforeach()
  file(CONFIGURE OUTPUT ${unit} CONTENT "${includes}" @ONLY)
  set(objects)
  foreach(source ${sources})
    get_filename_component(name ${source} NAME)
    set(object ${folder}/${name}.o)
    add_custom_command(OUTPUT ${object}
      COMMAND ${CMAKE_CXX_COMPILER_LAUNCHER} ${SLF_WASM_COMPILER} ${wasm_flags} ${module_FLAGS}
        -I${PROJECT_SOURCE_DIR}/page/wasm/include
        -I${PROJECT_SOURCE_DIR} -I${PROJECT_SOURCE_DIR}/include -isystem ${include}
        -MD -MF ${object}.d -c ${source} -o ${object}
      DEPENDS ${source} DEPFILE ${object}.d
      COMMENT "Building ${name} for WebAssembly" VERBATIM)
    list(APPEND objects ${object})
  endforeach()
  add_custom_command(OUTPUT ${output}
    COMMAND ${SLF_WASM_COMPILER} --target=wasm32-wasi ${wasm_link_flags} ${objects} -o ${output}
    DEPENDS ${objects} COMMENT "Linking ${output}" VERBATIM)
endfunction()
