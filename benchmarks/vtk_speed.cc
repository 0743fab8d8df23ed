// Compares VTK's ray-caster with ours and with a field: time, and similarity of the pictures.
//
//   vtk_speed VOLUME --field F.slf [--transfer TF.json] [--views N] [--size N]...
//             [--repeats N] [--json]
//
// Workload: N random views from 3 radii, warm. For each view in turn, REPEATS times: VTK's
// vtkFixedPointVolumeRayCastMapper (the ray-caster that needs no graphics card), our ray-caster,
// and the field in mode bitri and in its default mode. All use the same transfer function, light,
// step and threads. Reported per view: the median wall time of each, and the PSNR of VTK's picture
// and of the field's against our ray-caster's. Nothing is displayed: the time is that of casting
// rays into an image in memory.
#include <vtkCamera.h>
#include <vtkColorTransferFunction.h>
#include <vtkFixedPointRayCastImage.h>
#include <vtkFixedPointVolumeRayCastMapper.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkImageData.h>
#include <vtkLight.h>
#include <vtkMatrix4x4.h>
#include <vtkNew.h>
#include <vtkPiecewiseFunction.h>
#include <vtkPointData.h>
#include <vtkRenderer.h>
#include <vtkVersion.h>
#include <vtkVolume.h>
#include <vtkVolumeProperty.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>

#include "base/parallel.h"
#include "benchmarks/storage/expect.h"
#include "benchmarks/timing.h"
#include "cli/command.h"
#include "slf/scene.h"

namespace {

using namespace slf;
using bench::expect;

int vtk_type(ScalarType type) {
  switch (type) {
    case ScalarType::u8:
      return VTK_UNSIGNED_CHAR;
    case ScalarType::i8:
      return VTK_SIGNED_CHAR;
    case ScalarType::u16:
      return VTK_UNSIGNED_SHORT;
    case ScalarType::i16:
      return VTK_SHORT;
    case ScalarType::f32:
      return VTK_FLOAT;
    default:
      bench::stop("voxels of this type are not compared with VTK");
  }
}

/// A volume in VTK's ray-caster.
class VtkRaycaster {
 public:
  VtkRaycaster(const Volume& volume, const TransferFunction& transfer,
               const RaycastOptions& options, unsigned threads) {
    set_voxels(volume);
    set_look(volume, transfer, options);
    mapper_->SetInputData(voxels_);
    mapper_->SetNumberOfThreads(static_cast<int>(threads));
    mapper_->SetBlendModeToComposite();
    mapper_->AutoAdjustSampleDistancesOff();
    mapper_->IntermixIntersectingGeometryOff();  // else it reads the screen's depths
    mapper_->SetImageSampleDistance(1);
    const glm::dvec3 spacing = volume.spacing();
    mapper_->SetSampleDistance(
        static_cast<float>(options.step * std::min({spacing.x, spacing.y, spacing.z})));
    mapper_->Update();
    volume_->SetMapper(mapper_);
    window_->AddRenderer(renderer_);
    renderer_->AddVolume(volume_);
  }

  /// Casts all rays of a view; the picture stays in the mapper.
  void render(const Camera& camera) {
    window_->SetSize(static_cast<int>(camera.width), static_cast<int>(camera.height));
    vtkCamera* to = renderer_->GetActiveCamera();
    to->SetPosition(camera.eye.x, camera.eye.y, camera.eye.z);
    to->SetFocalPoint(camera.look_at.x, camera.look_at.y, camera.look_at.z);
    to->SetViewUp(camera.up.x, camera.up.y, camera.up.z);
    to->SetViewAngle(camera.fov);
    renderer_->ResetCameraClippingRange();
    mapper_->PerImageInitialization(renderer_, volume_, 0, nullptr, nullptr, nullptr);
    mapper_->PerVolumeInitialization(renderer_, volume_);
    mapper_->PerSubVolumeInitialization(renderer_, volume_, 0);
    mapper_->RenderSubVolume();
  }

  /// The last picture, converted to an Image: rows from the top, premultiplied.
  [[nodiscard]] Image image(const Camera& camera) const {
    Image image;
    image.width = camera.width, image.height = camera.height;
    image.rgba.assign(std::size_t{camera.width} * camera.height, glm::vec4(0));
    vtkFixedPointRayCastImage* from = mapper_->GetRayCastImage();
    const int* memory = from->GetImageMemorySize();
    const int* used = from->GetImageInUseSize();
    const int* origin = from->GetImageOrigin();
    const unsigned short* pixels = from->GetImage();
    for (int y = 0; y < used[1]; ++y)
      for (int x = 0; x < used[0]; ++x) {
        const auto row = static_cast<int>(camera.height) - 1 - (origin[1] + y);
        const unsigned short* p = pixels + 4 * (y * memory[0] + x);
        auto& out = image.rgba[static_cast<std::size_t>(row) * camera.width +
                               static_cast<std::size_t>(origin[0] + x)];
        for (int c = 0; c < 4; ++c) out[c] = std::min(1.f, static_cast<float>(p[c]) / 32767.f);
      }
    return image;
  }

 private:
  void set_voxels(const Volume& volume) {
    voxels_->SetDimensions(static_cast<int>(volume.dims[0]), static_cast<int>(volume.dims[1]),
                           static_cast<int>(volume.dims[2]));
    const glm::dvec3 spacing = volume.spacing();
    voxels_->SetSpacing(spacing.x, spacing.y, spacing.z);
    voxels_->AllocateScalars(vtk_type(volume.type), 1);
    std::memcpy(voxels_->GetScalarPointer(), volume.voxels.data(), volume.voxels.size());
    vtkNew<vtkMatrix4x4> to_world;
    for (int column = 0; column < 3; ++column)
      for (int row = 0; row < 3; ++row)
        to_world->SetElement(row, column, volume.axes[column][row] / spacing[column]);
    for (int row = 0; row < 3; ++row) to_world->SetElement(row, 3, volume.origin[row]);
    volume_->SetUserMatrix(to_world);
  }

  void set_look(const Volume& volume, const TransferFunction& transfer,
                const RaycastOptions& options) {
    // Sample at every stored integer, or evenly if they are too many or values are not integers.
    constexpr int kMaxPoints = 4096;
    const auto [low, high] = volume.value_range();
    const double stored = (high - low) / volume.slope;
    const int last = volume.type == ScalarType::f32 || stored > kMaxPoints
                         ? kMaxPoints
                         : std::max(1, static_cast<int>(std::lround(stored)));
    vtkNew<vtkColorTransferFunction> colors;
    vtkNew<vtkPiecewiseFunction> opacities;
    for (int k = 0; k <= last; ++k) {
      const double value = low + (high - low) * k / last;
      const double at = (value - volume.intercept) / volume.slope;
      const glm::dvec4 v = transfer(value);
      colors->AddRGBPoint(at, v.r, v.g, v.b);
      opacities->AddPoint(at, v.a);
    }
    vtkNew<vtkVolumeProperty> property;
    property->SetColor(colors);
    property->SetScalarOpacity(opacities);
    property->SetScalarOpacityUnitDistance(transfer.unit_distance);
    if (volume.labels)
      property->SetInterpolationTypeToNearest();
    else
      property->SetInterpolationTypeToLinear();
    property->SetShade(options.shade);
    property->SetAmbient(static_cast<double>(options.ambient));
    property->SetDiffuse(1 - static_cast<double>(options.ambient));
    property->SetSpecular(0);
    volume_->SetProperty(property);

    vtkNew<vtkLight> light;
    light->SetLightTypeToSceneLight();
    light->PositionalOff();
    light->SetFocalPoint(0, 0, 0);
    light->SetAmbientColor(1, 1, 1);
    light->SetPosition(options.light.x, options.light.y, options.light.z);
    renderer_->AutomaticLightCreationOff();
    renderer_->AddLight(light);
  }

  vtkNew<vtkImageData> voxels_;
  vtkNew<vtkVolume> volume_;
  vtkNew<vtkFixedPointVolumeRayCastMapper> mapper_;
  vtkNew<vtkRenderer> renderer_;
  vtkNew<vtkGenericOpenGLRenderWindow> window_;  // only for its size: nothing is drawn in it
};

struct Arguments {
  cli::SourceArguments source;
  std::string field, pictures;
  std::vector<std::uint32_t> sizes{512};
  std::uint32_t views = 4;
  std::uint64_t seed = 1;
  int repeats = 5;
  unsigned threads = 0;
  bool json = false;
};

/// The ways to draw one volume.
struct Contenders {
  VtkRaycaster& vtk;
  const Raycaster& raycaster;
  Renderer& renderer;
  const Field& field;
  unsigned threads;
};

nlohmann::json measure_view(const Contenders& c, const Camera& camera, int repeats,
                            const std::string& pictures) {
  const RenderMode best = default_mode(c.field);
  const unsigned level = c.field.shape().finest_level;
  Image truth, from_field;
  const auto draw = [&](RenderMode mode) {  // into the same picture, as VTK does
    expect(c.renderer.render(camera, {mode, level}, from_field));
  };
  std::array<bench::Times, 4> times;
  for (int k = 0; k <= repeats; ++k) {  // the first turn fills caches and is not counted
    if (k == 1) times = {};
    times[0].run([&] { c.vtk.render(camera); });
    times[1].run([&] {
      truth = expect(trace_view(c.raycaster, c.field.shape().sphere, camera, c.threads));
    });
    times[2].run([&] { draw(RenderMode::bitri); });
    times[3].run([&] { draw(best); });
  }
  const Image other = c.vtk.image(camera);
  if (!pictures.empty()) {
    expect(write_image(pictures + "-vtk.png", other));
    expect(write_image(pictures + "-raycast.png", truth));
    expect(write_image(pictures + "-field.png", from_field));
  }
  return {{"size", camera.width},
          {"vtk_ms", 1e3 * times[0].median_wall()},
          {"vtk_cpu_ms", 1e3 * times[0].median_cpu()},
          {"raycast_ms", 1e3 * times[1].median_wall()},
          {"bitri_ms", 1e3 * times[2].median_wall()},
          {"field_ms", 1e3 * times[3].median_wall()},
          {"field_cpu_ms", 1e3 * times[3].median_cpu()},
          {"vtk_psnr_to_raycast", compare(other, truth).psnr},
          {"field_psnr", compare(from_field, truth).psnr}};
}

nlohmann::json measure(const Arguments& a) {
  const auto field = expect(Field::open(a.field));
  const Volume volume = expect(read_volume(a.source));
  const TransferFunction transfer = a.source.transfer.empty()
                                        ? default_transfer(volume)
                                        : expect(read_transfer(a.source.transfer)).fit(volume);
  const RaycastOptions options = a.source.raycast;
  const unsigned threads = thread_count(a.threads);
  VtkRaycaster vtk(volume, transfer, options, threads);
  const auto raycaster = expect(Raycaster::make(volume, transfer, options));
  Renderer renderer(field, {4ull << 30, threads});
  const Contenders contenders{vtk, *raycaster, renderer, field, threads};

  nlohmann::json views = nlohmann::json::array();
  std::string pictures = a.pictures;  // of the first view
  for (const std::uint32_t size : a.sizes)
    for (const Camera& camera :
         random_cameras(field.shape().sphere, 3, a.views, a.seed, size, size)) {
      views.push_back(measure_view(contenders, camera, a.repeats, pictures));
      pictures.clear();
    }
  return {{"vtk", vtkVersion::GetVTKVersion()},
          {"threads", threads},
          {"repeats", a.repeats},
          {"mode", name(default_mode(field))},
          {"views", views}};
}

void print(const nlohmann::json& result) {
  std::printf("VTK %s, %u threads, median of %d, ms; PSNR in dB\n",
              result["vtk"].get<std::string>().c_str(), result["threads"].get<unsigned>(),
              result["repeats"].get<int>());
  std::printf("%6s %8s %8s %8s %8s %10s %10s %10s\n", "size", "VTK", "raycast", "bitri",
              result["mode"].get<std::string>().c_str(), "VTK/field", "VTK~ours", "field");
  std::vector<double> ratios;
  for (const auto& v : result["views"]) {
    const auto of = [&](const char* key) { return v[key].get<double>(); };
    ratios.push_back(of("vtk_ms") / of("field_ms"));
    std::printf("%6u %8.1f %8.1f %8.2f %8.2f %10.1f %10.1f %10.1f\n", v["size"].get<unsigned>(),
                of("vtk_ms"), of("raycast_ms"), of("bitri_ms"), of("field_ms"), ratios.back(),
                of("vtk_psnr_to_raycast"), of("field_psnr"));
  }
  std::printf("median VTK/field %.1f\n", bench::median(ratios));
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"VTK's ray-caster, ours, and a field, on the same views"};
  Arguments a;
  a.source.add_input_to(app, "VOLUME");
  a.source.add_to(app, [](const auto& option) { return option.use != recipe::Use::field; });
  app.add_option("--field", a.field, "Field of the same volume")->required();
  app.add_option("--views", a.views)->capture_default_str();
  app.add_option("--seed", a.seed)->capture_default_str();
  app.add_option("--size", a.sizes, "Edges of the pictures")->capture_default_str();
  app.add_option("--repeats", a.repeats)->capture_default_str();
  app.add_option("-j,--threads", a.threads, "0: all cores")->capture_default_str();
  app.add_option("--pictures", a.pictures, "Write the first view's pictures here, as PREFIX-*.png");
  app.add_flag("--json", a.json);
  CLI11_PARSE(app, argc, argv);
  expect(a.source.finish(a.threads, cli::OnSignal::end));
  const nlohmann::json result = measure(a);
  if (a.json)
    std::printf("%s\n", result.dump(2).c_str());
  else
    print(result);
  return 0;
}
