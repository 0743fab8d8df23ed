# Peers are optional: without their libraries there is nothing to compare with.
pkg_check_modules(WEBP IMPORTED_TARGET libwebp)
pkg_check_modules(JPEG IMPORTED_TARGET libjpeg)
find_package(PNG)
find_package(CLI11)
if(WEBP_FOUND AND JPEG_FOUND AND PNG_FOUND AND CLI11_FOUND)
  pkg_check_modules(ZSTD REQUIRED IMPORTED_TARGET libzstd)
  add_executable(codec_peers codec_peers.cc codec_contenders.cc)
  target_link_libraries(codec_peers PRIVATE
    slf::slf PkgConfig::WEBP PkgConfig::JPEG PkgConfig::ZSTD PNG::PNG CLI11::CLI11 slf_options)
endif()
