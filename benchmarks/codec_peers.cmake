# Peers are optional: without their libraries there is nothing to compare with.
if(WEBP_FOUND AND JPEG_FOUND AND PNG_FOUND AND CLI11_FOUND)
  add_executable(codec_peers codec_peers.cc codec_contenders.cc)
  target_link_libraries(codec_peers PRIVATE
    slf::slf PkgConfig::WEBP PkgConfig::JPEG PkgConfig::ZSTD PNG::PNG CLI11::CLI11 slf_options)
endif()
