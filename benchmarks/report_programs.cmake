# The programs that scripts/report runs.

# The command line's own arguments: a volume is named everywhere as it is to slf.
add_library(bench_arguments STATIC ../cli/arguments.cc ../cli/open.cc
  ../cli/output.cc ../cli/progress.cc ../cli/source_options.cc)
target_link_libraries(bench_arguments PUBLIC slf::slf CLI11::CLI11 PRIVATE fmt::fmt slf_options)

add_executable(entry_pictures entry_pictures.cc)
target_link_libraries(entry_pictures PRIVATE slf::slf CLI11::CLI11 slf_options)
add_executable(light_quality light_quality.cc)
target_link_libraries(light_quality PRIVATE
  bench_arguments nlohmann_json::nlohmann_json slf_options)
add_executable(exr_peer exr_peer.cc)
target_link_libraries(exr_peer PRIVATE
  OpenEXR::OpenEXR CLI11::CLI11 nlohmann_json::nlohmann_json slf_options)

find_package(VTK 9 QUIET COMPONENTS CommonCore CommonDataModel RenderingCore RenderingOpenGL2
                                    RenderingVolume RenderingVolumeOpenGL2)
if(VTK_FOUND)
  add_executable(vtk_speed vtk_speed.cc)
  target_link_libraries(vtk_speed PRIVATE bench_arguments ${VTK_LIBRARIES} slf_options)
  vtk_module_autoinit(TARGETS vtk_speed MODULES ${VTK_LIBRARIES})
else()
  message(STATUS "vtk_speed is left out: VTK 9 not found (libvtk9-dev)")
endif()

# The traditional light field, between planes.
add_library(bench_plane STATIC plane/plane_field.cc plane/plane_kernel.cc)
target_link_libraries(bench_plane
  PUBLIC slf::slf PRIVATE PkgConfig::HWY Threads::Threads slf_options)
add_executable(systems systems.cc)
target_link_libraries(systems PRIVATE bench_arguments bench_plane Threads::Threads slf_options)

add_executable(turntable turntable.cc)
target_link_libraries(turntable PRIVATE bench_arguments slf_options)

add_executable(view_times view_times.cc storage/page_cache.cc)
target_link_libraries(view_times PRIVATE bench_arguments slf_options)

add_executable(sampling_quality sampling_quality.cc)
target_link_libraries(sampling_quality PRIVATE bench_arguments Threads::Threads slf_options)

add_custom_target(report_programs)
foreach(program codec_peers entry_pictures exr_peer light_quality sampling_quality systems
                turntable view_times vtk_speed)
  if(TARGET ${program})
    add_dependencies(report_programs ${program})
  endif()
endforeach()
