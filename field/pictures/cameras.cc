#include "field/pictures/cameras.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <set>

#include "base/file.h"
#include "base/lower_case.h"
#include "base/try.h"
#include "field/geometry/directions.h"
#include "field/image/formats.h"

namespace slf {
namespace {

namespace fs = std::filesystem;

}  // namespace

std::vector<std::string> PictureSet::files() const {
  std::vector<std::string> files = models;
  files.push_back(source);
  for (const Picture& picture : pictures)
    for (const std::string* file : {&picture.file, &picture.mask, &picture.depth})
      if (!file->empty()) files.push_back(*file);
  return files;
}

Result<PictureSet> read_cameras(const std::string& path) {
  const auto bytes = SLF_TRY(read_file(path, cameras::kMaxFileBytes));
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const std::string folder = fs::path(path).parent_path().string();
  if (path.ends_with(".csv")) return cameras::parse_cinema(text, path, folder);
  return cameras::parse_transforms(text, path, folder);
}

namespace {

/// COLMAP's folder of pictures, beside `sparse` or where the model is.
std::string image_folder(const std::string& folder) {
  std::error_code ignored;
  for (const char* name : {"images", "input"})
    if (fs::is_directory(fs::path(folder) / name, ignored)) return folder + "/" + name;
  return folder;
}

Result<PictureSet> read_model(const std::string& model_folder, const std::string& pictures) {
  const auto model = SLF_TRY(cameras::read_colmap(model_folder));
  auto set = cameras::parse_colmap(model, pictures);
  if (!set) return set;
  for (const char* name : {"/cameras", "/images", "/points3D"})
    set->models.push_back(model_folder + name + (model.text ? ".txt" : ".bin"));
  std::set<std::string> named;
  for (const Picture& picture : set->pictures) named.insert(picture.file);
  std::size_t without = 0;
  std::error_code code;  // pictures in folders that cannot be read are not counted
  auto it = fs::recursive_directory_iterator(pictures,
                                             fs::directory_options::skip_permission_denied, code);
  for (; !code && it != fs::recursive_directory_iterator(); it.increment(code)) {
    const std::string extension = lower_case(it->path().extension().string());
    for (const char* picture : {".jpg", ".jpeg", ".png", ".tif", ".tiff"})
      if (extension == picture) without += named.count(it->path().lexically_normal().string()) == 0;
  }
  if (without > 0)
    set->notes.push_back(std::to_string(without) +
                         " pictures without a camera, which the model could not place, are not "
                         "used");
  return set;
}

Result<PictureSet> read_folder(const std::string& folder) {
  std::error_code ignored;
  for (const char* name : {"transforms.json", "transforms_train.json", "data.csv"})
    if (fs::is_regular_file(fs::path(folder) / name, ignored))
      return read_cameras((fs::path(folder) / name).string());
  for (const char* place : {"", "sparse/0", "sparse", "colmap/sparse/0"}) {
    const std::string model = (fs::path(folder) / place).string();
    if (cameras::colmap_form(model) == cameras::ColmapForm::none) continue;
    std::string pictures = image_folder(folder);
    // A folder sparse/0 that was named itself.
    for (fs::path up = fs::absolute(folder); pictures == folder && up.has_relative_path();) {
      up = up.parent_path();
      if (fs::is_directory(up / "images", ignored)) pictures = (up / "images").string();
      if (up.filename() != "sparse") break;
    }
    return read_model(model, pictures);
  }
  return fail(ErrorCode::bad_file, folder,
              ": no cameras; expected transforms.json, transforms_train.json, data.csv of a Cinema "
              "database, or COLMAP's cameras.bin and images.bin here, in sparse or in sparse/0");
}

}  // namespace

Result<void> cameras::check_sizes(PictureSet& set) {
  std::size_t scaled = 0;
  std::string example;
  for (Picture& picture : set.pictures) {
    std::error_code ignored;
    if (!fs::is_regular_file(picture.file, ignored))
      return fail(ErrorCode::io, set.source, ": ", picture.name, ": there is no picture ",
                  picture.file, " for this camera");
    const auto size = SLF_TRY(image_formats::read_image_size(picture.file));
    Lens& lens = picture.lens;
    if (size == image_formats::ImageSize{lens.width, lens.height}) continue;
    const double sx = size.width / static_cast<double>(lens.width);
    const double sy = size.height / static_cast<double>(lens.height);
    if (size.width == lens.height && size.height == lens.width)
      return fail(ErrorCode::bad_file, picture.file, ": is ", size.width, "x", size.height,
                  " pixels, transposed beside its camera of ", lens.width, "x", lens.height,
                  ": it was turned after the cameras were found; turn it back, and remove the "
                  "orientation from its EXIF data");
    // Rounded sizes differ by up to a pixel.
    if (std::abs(lens.width * sy - size.width) > 1.5 &&
        std::abs(lens.height * sx - size.height) > 1.5)
      return fail(ErrorCode::bad_file, picture.file, ": is ", size.width, "x", size.height,
                  " pixels; its camera has another shape, ", lens.width, "x", lens.height);
    if (scaled++ == 0)
      example = std::to_string(lens.width) + "x" + std::to_string(lens.height) + " to " +
                std::to_string(size.width) + "x" + std::to_string(size.height);
    lens.fx *= sx, lens.cx *= sx;
    lens.fy *= sy, lens.cy *= sy;
    lens.width = size.width;
    lens.height = size.height;
    lens.finish();
  }
  if (scaled > 0)
    set.notes.push_back(std::to_string(scaled) +
                        " cameras were found at another size than their pictures have, and are "
                        "scaled (" +
                        example + ")");
  return {};
}

Result<PictureSet> read_pictures(const std::string& path) {
  std::error_code ignored;
  auto set = fs::is_directory(path, ignored) ? read_folder(path) : read_cameras(path);
  if (!set) return set;
  std::ranges::stable_sort(set->pictures, {}, &Picture::name);
  for (std::size_t k = 1; k < set->pictures.size(); ++k)
    if (set->pictures[k].file == set->pictures[k - 1].file)
      return fail(ErrorCode::bad_file, set->source, ": ", set->pictures[k].name,
                  ": the picture is there twice");
  SLF_TRY(cameras::check_sizes(*set));
  return set;
}

std::optional<glm::dvec3> focus_of(const std::vector<Picture>& pictures) {
  glm::dmat3 matrix(0.0);
  glm::dvec3 right(0.0);
  for (const Picture& picture : pictures) {
    const glm::dvec3& axis = picture.axes[2];
    const glm::dmat3 across = glm::dmat3(1.0) - glm::outerProduct(axis, axis);
    matrix += across;
    right += across * picture.eye;
  }
  matrix /= static_cast<double>(pictures.size());
  right /= static_cast<double>(pictures.size());
  if (!(std::abs(glm::determinant(matrix)) > 1e-4)) return std::nullopt;
  return glm::inverse(matrix) * right;
}

std::vector<Picture> spread_cameras(const Sphere& sphere, double distance, std::uint32_t count,
                                    std::uint32_t width, std::uint32_t height) {
  std::vector<Picture> pictures;
  for (std::uint32_t k = 0; k < count; ++k) {
    const glm::dvec3 toward = even_direction(k, count);
    Picture picture;
    const std::string digits = std::to_string(k);
    picture.name = std::string(digits.size() < 4 ? 4 - digits.size() : 0, '0') + digits;
    picture.eye = sphere.center + distance * sphere.radius * toward;
    const glm::dvec3 right = glm::normalize(glm::cross(-toward, any_up(toward)));
    picture.axes = glm::dmat3(right, glm::cross(-toward, right), -toward);
    Lens& lens = picture.lens;
    lens.width = width;
    lens.height = height;
    const double fov = fitted_fov(sphere, distance * sphere.radius, width, height);
    lens.fx = lens.fy = height / 2.0 / std::tan(fov * std::numbers::pi / 360);
    lens.cx = width / 2.0;
    lens.cy = height / 2.0;
    lens.finish();
    pictures.push_back(std::move(picture));
  }
  return pictures;
}

}  // namespace slf
