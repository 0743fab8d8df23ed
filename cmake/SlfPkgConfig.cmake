# slf_pkg_config(TARGET): slf.pc, for programs that are not built with CMake, made from the
# libraries that the target links. A library that this file does not list stops the configuration.
set(slf_pc_requires
  PkgConfig::LMDB=lmdb PkgConfig::XXHASH=libxxhash PkgConfig::ZSTD=libzstd PkgConfig::JPEG=libjpeg
  PkgConfig::HWY=libhwy PkgConfig::WEBP=libwebpmux PNG::PNG=libpng ZLIB::ZLIB=zlib
  PkgConfig::LZ4=liblz4 PkgConfig::LZMA=liblzma OpenEXR::OpenEXR=OpenEXR
  TIFF::TIFF=libtiff-4 PkgConfig::SIMDJSON=simdjson PkgConfig::PUGIXML=pugixml
  PkgConfig::MINIZIP=minizip)
set(slf_pc_libs
  Threads::Threads=-pthread BZip2::BZip2=-lbz2 embree=-lembree3)
set(slf_pc_headers tl::expected glm::glm nlohmann_json::nlohmann_json slf_options)

# Adds `target` and what it links to the lists OURS, LIBS and REQUIRES, users before what they use.
function(slf_pc_collect target)
  get_target_property(aliased ${target} ALIASED_TARGET)
  if(aliased)
    set(target ${aliased})
  endif()
  if(target IN_LIST visited)
    return()
  endif()
  list(APPEND visited ${target})
  get_target_property(type ${target} TYPE)
  get_target_property(linked ${target} INTERFACE_LINK_LIBRARIES)
  if(NOT linked)
    set(linked)
  endif()
  foreach(item ${linked})
    string(REGEX REPLACE "^\\$<LINK_ONLY:(.*)>$" "\\1" item ${item})
    if(item MATCHES "^\\$<")  # of the build alone
      continue()
    endif()
    if(item IN_LIST slf_pc_headers)
      continue()
    elseif(item MATCHES "^slf(::|_)")
      slf_pc_collect(${item})
    elseif("${slf_pc_requires}" MATCHES "${item}=([^;]*)")
      list(APPEND requires ${CMAKE_MATCH_1})
    elseif("${slf_pc_libs}" MATCHES "${item}=([^;]*)")
      list(APPEND libs ${CMAKE_MATCH_1})
    else()
      message(FATAL_ERROR "cmake/SlfPkgConfig.cmake does not know ${item}, which ${target} links")
    endif()
  endforeach()
  if(NOT type STREQUAL INTERFACE_LIBRARY)
    list(PREPEND ours -l${target})
  endif()
  foreach(name visited ours libs requires)
    set(${name} ${${name}} PARENT_SCOPE)
  endforeach()
endfunction()

function(slf_pkg_config target)
  slf_pc_collect(${target})
  list(REMOVE_DUPLICATES libs)
  list(REMOVE_DUPLICATES requires)
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
endfunction()
