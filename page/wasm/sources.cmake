# What reads and decodes fields without any compiled library: the page's WebAssembly, and what
# tests/portable runs on other processors.
set(SLF_PORTABLE_SOURCES
  storage/pages.cc storage/trees.cc storage/cursor.cc storage/record.cc storage/container.cc
  storage/ranged_store.cc storage/range_set.cc storage/file_index.cc
  codec/codec.cc
  codec/zstd_codec.cc codec/byte_streams.cc codec/lane_samples.cc
  codec/lanes.cc codec/portable/zstd_frame.cc
  codec/jpeg_codec.cc codec/jpeg_encode.cc codec/jpeg_pictures.cc
  codec/jpeg_tables.cc codec/fill.cc codec/mosaic.cc codec/color_kernel.cc
  codec/portable/jpeg_decode.cc
  codec/kept_rays.cc codec/predictive.cc codec/predictive_channels.cc codec/predictive_codec.cc
  codec/predictive_tables.cc codec/log_colors.cc codec/rans.cc codec/dct.cc
  field/predict/prediction_kernel.cc field/predict/predictor.cc field/predict/references.cc
  field/predict/upsample_kernel.cc
  field/tile_coder.cc field/reference_index.cc field/tiles/compose_samples.cc
  field/manifest.cc field/geometry/lattice.cc field/geometry/section.cc
  field/geometry/level_geometry.cc field/geometry/shape.cc)
# What cuts need: decoding a reveal, and the ray-caster's light. Files that share names of their own
# are in this order.
set(SLF_CUT_SOURCES
  source/transfer/transfer.cc source/transfer/transfer_color.cc source/transfer/transfer_fit.cc
  source/transfer/transfer_json.cc source/transfer/transfer_labels.cc
  codec/brick_volume.cc field/reveal/reveal.cc base/content_hash.cc
  source/raycast/cap_settings.cc source/raycast/provenance.cc source/raycast/volume_parts.cc
  source/raycast/prepared_volume.cc source/raycast/raycaster_kernel.cc
  source/light/illumination.cc source/light/light_volume.cc source/light/light_depth.cc
  source/light/light_filter.cc source/light/light_rig.cc
  source/medium/medium.cc source/medium/medium_kernel.cc source/medium/transfer_table.cc
  source/medium/visible_space.cc
  source/volume/values.cc source/volume/text.cc source/volume/content.cc)
