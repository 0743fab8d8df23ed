# slf_library(NAME): the one target of a folder, slf::NAME, made of every .cc in it.
# Headers are included as "NAME/header.h", in the tree and once installed.

add_library(slf_options INTERFACE)
target_compile_options(slf_options INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual -Werror)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # GCC 12 sees overlaps in std::string that are not there (GCC bug 105651).
  target_compile_options(slf_options INTERFACE -Wno-restrict)
endif()
if(SLF_SANITIZE)
  target_compile_options(slf_options INTERFACE -fsanitize=${SLF_SANITIZE}
    -fno-omit-frame-pointer -fno-sanitize-recover=undefined)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    # Under sanitizers GCC 12 takes its own vector intrinsics for uninitialised (GCC bug 105593).
    target_compile_options(slf_options INTERFACE -Wno-maybe-uninitialized)
    # And the thread sanitizer does not follow fences; ours order system calls only.
    target_compile_options(slf_options INTERFACE -Wno-tsan)
  endif()
  target_link_options(slf_options INTERFACE -fsanitize=${SLF_SANITIZE})
endif()

function(slf_library name)
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cc)
  file(GLOB headers CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.h)
  add_library(slf_${name} STATIC ${sources})
  add_library(slf::${name} ALIAS slf_${name})
  set_target_properties(slf_${name} PROPERTIES EXPORT_NAME ${name} POSITION_INDEPENDENT_CODE ON LINKER_LANGUAGE CXX)
  target_include_directories(slf_${name} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/slf>)
  target_compile_features(slf_${name} PUBLIC cxx_std_20)
  target_link_libraries(slf_${name} PRIVATE $<BUILD_INTERFACE:slf_options>)
  install(TARGETS slf_${name} EXPORT slf-targets)
  install(FILES ${headers} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/slf/${name})
endfunction()
