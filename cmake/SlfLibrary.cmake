# slf_library(NAME [SOURCES...]): the library slf::NAME, made of the sources given or, without any,
# of every .cc in its folder.
#
# Public headers are those in include/slf; every other header is internal and is not installed.

add_library(slf_options INTERFACE)
target_compile_options(slf_options INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual -Werror)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # GCC 12 sees overlaps in std::string that are not there (GCC bug 105651).
  target_compile_options(slf_options INTERFACE -Wno-restrict)
  if(CMAKE_UNITY_BUILD)  # in which names of one source stand before those of the next
    target_compile_options(slf_options INTERFACE -Wno-shadow -Wno-subobject-linkage)
  endif()
endif()
if(CMAKE_SYSTEM_PROCESSOR STREQUAL "aarch64")
  # Highway's NEON vectors take them for granted.
  target_compile_options(slf_options INTERFACE -march=armv8-a+crypto)
endif()
if(SLF_SANITIZE)
  target_compile_options(slf_options INTERFACE -fsanitize=${SLF_SANITIZE}
    -fno-omit-frame-pointer -fno-sanitize-recover=undefined)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    # GCC 12 warns of faults that only its instrumentation seems to make (GCC bug 105593, and
    # fences under the thread sanitizer). The other presets fail on every warning.
    target_compile_options(slf_options INTERFACE -w)
  endif()
  target_link_options(slf_options INTERFACE -fsanitize=${SLF_SANITIZE})
endif()

function(slf_library name)
  set(sources ${ARGN})
  if(NOT sources)
    file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cc)
  endif()
  foreach(source ${sources})
    # Highway includes such a file again for each instruction set: no other may stand beside it.
    file(STRINGS ${source} is_kernel REGEX "hwy/foreach_target" LIMIT_COUNT 1)
    if(is_kernel)
      set_source_files_properties(${source} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
    endif()
  endforeach()
  add_library(slf_${name} ${sources})
  add_library(slf::${name} ALIAS slf_${name})
  set_target_properties(slf_${name} PROPERTIES
    EXPORT_NAME ${name}
    POSITION_INDEPENDENT_CODE ON
    LINKER_LANGUAGE CXX
    VERSION ${PROJECT_VERSION}
    SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
  target_include_directories(slf_${name} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_compile_features(slf_${name} PUBLIC cxx_std_20)
  target_link_libraries(slf_${name} PRIVATE $<BUILD_INTERFACE:slf_options>)
  install(TARGETS slf_${name} EXPORT slf-targets)
endfunction()
