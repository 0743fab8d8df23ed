# Rooms and libraries.
#
# slf_room(NAME [SOURCES...] [USES rooms...] [NEEDS dependencies...]): a room, made of the sources
# given or, without any, of every .cc in its folder. It may include the headers of the rooms that it
# uses and of the dependencies that it needs (cmake/dependencies.txt).
#
# slf_library(NAME ROOMS rooms... [LINKS libraries...]): the library slf::NAME, which is installed:
# the objects of these rooms. A room belongs to one library.
#
# Public headers are those in include/slf; every other header is internal and is not installed.

add_library(slf_options INTERFACE)
target_compile_options(slf_options INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual -Werror)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # GCC 12 sees overlaps in std::string that are not there (GCC bug 105651).
  target_compile_options(slf_options INTERFACE -Wno-restrict)
endif()
if(CMAKE_UNITY_BUILD)  # in which names of one source stand before those of the next
  target_compile_options(slf_options INTERFACE -Wno-shadow
    $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
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

function(slf_room name)
  cmake_parse_arguments(room "" "" "SOURCES;USES;NEEDS" ${ARGN})
  if(NOT room_SOURCES)
    file(GLOB room_SOURCES CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cc)
  endif()
  foreach(source ${room_SOURCES})
    # Highway includes such a file again for each instruction set: no other may stand beside it.
    file(STRINGS ${source} is_kernel REGEX "hwy/foreach_target" LIMIT_COUNT 1)
    if(is_kernel)
      # Each instruction set takes time to compile. Old processors with SSSE3 but without SSE4.1
      # run scalar code.
      set_source_files_properties(${source} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON
        COMPILE_DEFINITIONS HWY_DISABLED_TARGETS=HWY_SSSE3)
    endif()
  endforeach()
  add_library(slf_${name} OBJECT ${room_SOURCES})
  set_target_properties(slf_${name} PROPERTIES POSITION_INDEPENDENT_CODE ON)
  target_include_directories(slf_${name} PUBLIC ${PROJECT_SOURCE_DIR} ${PROJECT_SOURCE_DIR}/include)
  target_link_libraries(slf_${name} PRIVATE slf_options)
  foreach(used ${room_USES})
    target_link_libraries(slf_${name} PUBLIC slf_${used})
  endforeach()
  foreach(need ${room_NEEDS})
    target_link_libraries(slf_${name} PUBLIC ${slf_${need}_target})
  endforeach()
  set_property(TARGET slf_${name} PROPERTY SLF_NEEDS "${room_NEEDS}")
endfunction()

function(slf_library name)
  cmake_parse_arguments(library "" "" "ROOMS;LINKS" ${ARGN})
  set(objects)
  set(needs)
  foreach(room ${library_ROOMS})
    list(APPEND objects $<TARGET_OBJECTS:slf_${room}>)
    get_target_property(room_needs slf_${room} SLF_NEEDS)
    list(APPEND needs ${room_needs})
  endforeach()
  list(REMOVE_DUPLICATES needs)
  add_library(slf_${name}_library ${objects})
  add_library(slf::${name} ALIAS slf_${name}_library)
  set_target_properties(slf_${name}_library PROPERTIES
    OUTPUT_NAME slf_${name}
    EXPORT_NAME ${name}
    LINKER_LANGUAGE CXX
    VERSION ${PROJECT_VERSION}
    SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
  target_include_directories(slf_${name}_library PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_compile_features(slf_${name}_library PUBLIC cxx_std_20)
  target_link_libraries(slf_${name}_library PRIVATE $<BUILD_INTERFACE:slf_options>)
  foreach(link ${library_LINKS})
    target_link_libraries(slf_${name}_library PUBLIC slf::${link})
    list(APPEND needs ${slf_${link}_needs})
  endforeach()
  foreach(need ${needs})
    set(target ${slf_${need}_target})
    if(slf_${need}_link STREQUAL "public")
      target_link_libraries(slf_${name}_library PUBLIC ${target})
    elseif(slf_${need}_link STREQUAL "private")
      target_link_libraries(slf_${name}_library PRIVATE ${target})
    else()
      target_link_libraries(slf_${name}_library PUBLIC $<BUILD_INTERFACE:${target}>)
    endif()
  endforeach()
  list(REMOVE_DUPLICATES needs)
  set(slf_${name}_needs ${needs} CACHE INTERNAL "All that slf::${name} links")
  set(slf_libraries ${slf_libraries} ${name} CACHE INTERNAL "The installed libraries, in order")
  install(TARGETS slf_${name}_library EXPORT slf-targets)
endfunction()
set(slf_libraries "" CACHE INTERNAL "The installed libraries, in order")
