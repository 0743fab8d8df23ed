#include "source/pictures/cameras.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "base/ascii.h"
#include "base/file.h"
#include "base/join.h"
#include "base/try.h"
#include "base/utf8.h"
#include "field/geometry/directions.h"
#include "source/volume/formats.h"

namespace slf {

namespace fs = std::filesystem;

std::vector<std::string> PictureSet::files() const {
  std::vector<std::string> files = models;
  files.push_back(source);
  for (const Picture& picture : pictures)
    for (const std::string* file : {&picture.file, &picture.mask, &picture.depth})
      if (!file->empty()) files.push_back(*file);
  return files;
}

Result<PictureSet> read_cameras(const std::string& path) try {
  const auto bytes = SLF_TRY(read_file(path, cameras::kMaxFileBytes));
  std::string made;
  const std::string_view text = as_utf8(chars_of(bytes), made);
  SLF_TRY(volume_io::refuse_known(path, text.substr(0, 4096)));
  const std::string folder = fs::path(path).parent_path().string();
  if (path.ends_with(".csv")) return cameras::parse_cinema(text, path, folder);
  return cameras::parse_transforms(text, path, folder);
} catch (...) {
  return tl::unexpected(error_of_exception());
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
  auto set = SLF_TRY(cameras::parse_colmap(model, pictures));
  for (const char* name : {"/cameras", "/images", "/points3D"})
    set.models.push_back(model_folder + name + (model.text ? ".txt" : ".bin"));
  cameras::PictureFinder finder(pictures);
  std::set<std::string> named;
  for (Picture& picture : set.pictures) {
    picture.file = finder.find(picture.name);
    named.insert(picture.file);
  }
  finder.add_notes(set.notes);
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
    set.notes.push_back(concat(
        without, " pictures without a camera, which the model could not place, are not used"));
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
  return bad_file(
      folder,
      "no cameras; expected transforms.json, transforms_train.json, data.csv of a Cinema database, "
      "or COLMAP's cameras.bin and images.bin here, in sparse or in sparse/0");
}

/// Whether a picture and its mask are there, and fit the camera. Returns the size.
Result<image_formats::ImageSize> check_picture(const std::string& source, const Picture& picture) {
  std::error_code ignored;
  const auto size = SLF_TRY(cameras::size_of(source, picture));
  if (!picture.mask.empty() && !fs::is_regular_file(picture.mask, ignored))
    return fail(ErrorCode::not_found, source, ": ", picture.name, ": there is no mask ",
                picture.mask, " for this camera");
  const Lens& lens = picture.lens;
  if (size == image_formats::ImageSize{lens.width, lens.height}) return size;
  if (size.width == lens.height && size.height == lens.width)
    return bad_file(picture.file, "is ", size.width, "x", size.height,
                    " pixels, transposed beside its camera of ", lens.width, "x", lens.height,
                    ": it was turned after the cameras were found; turn it back, and remove the "
                    "orientation from its EXIF data");
  // Rounded sizes differ by up to a pixel.
  const double sx = 1.0 * size.width / lens.width, sy = 1.0 * size.height / lens.height;
  if (std::abs(lens.width * sy - size.width) > 1.5 &&
      std::abs(lens.height * sx - size.height) > 1.5)
    return bad_file(picture.file, "is ", size.width, "x", size.height,
                    " pixels; its camera has another shape, ", lens.width, "x", lens.height);
  return size;
}

}  // namespace

Result<image_formats::ImageSize> cameras::size_of(const std::string& source,
                                                  const Picture& picture) {
  std::error_code ignored;
  if (!fs::is_regular_file(picture.file, ignored))
    return fail(ErrorCode::not_found, source, ": ", picture.name, ": there is no picture ",
                picture.file, " for this camera");
  return image_formats::read_image_size(picture.file);
}

Lens cameras::pinhole_lens(std::uint32_t width, std::uint32_t height, double angle) {
  Lens lens;
  lens.width = width, lens.height = height;
  lens.fx = lens.fy = height / 2.0 / std::tan(angle * std::numbers::pi / 360);
  lens.cx = width / 2.0, lens.cy = height / 2.0;
  lens.finish();
  return lens;
}

Result<void> cameras::check_sizes(PictureSet& set) {
  std::size_t scaled = 0, without_depths = 0;
  std::string example;
  LeftOut left_out;
  std::vector<Picture> kept;
  for (Picture& picture : set.pictures) {
    auto size = check_picture(set.source, picture);
    if (!size) {
      SLF_TRY(left_out.add(std::move(size.error())));
      continue;
    }
    std::error_code ignored;
    if (!picture.depth.empty() && !fs::is_regular_file(picture.depth, ignored)) {
      picture.depth.clear();
      ++without_depths;
    }
    Lens& lens = picture.lens;
    if (*size != image_formats::ImageSize{lens.width, lens.height}) {
      if (scaled++ == 0)
        example = concat(lens.width, "x", lens.height, " to ", size->width, "x", size->height);
      const double sx = 1.0 * size->width / lens.width, sy = 1.0 * size->height / lens.height;
      lens.fx *= sx, lens.cx *= sx;
      lens.fy *= sy, lens.cy *= sy;
      lens.width = size->width;
      lens.height = size->height;
      lens.finish();
    }
    kept.push_back(std::move(picture));
  }
  set.pictures = std::move(kept);
  SLF_TRY(left_out.settle(set.pictures.size(), set.notes));
  if (without_depths > 0)
    set.notes.push_back(std::to_string(without_depths) + " pictures of depths are missing");
  if (scaled > 0)
    set.notes.push_back(concat(
        scaled, " cameras were found at another size than their pictures have, and are scaled (",
        example, ")"));
  return {};
}

cameras::PictureFinder::PictureFinder(const std::string& folder)
    : folder_(folder),
      finder_(folder, {".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".hdr"}) {}

std::string cameras::PictureFinder::find(const std::string& stated) {
  return finder_.find(stated).value_or((fs::path(folder_) / stated).lexically_normal().string());
}

void cameras::PictureFinder::add_notes(std::vector<std::string>& notes) const {
  if (finder_.moved() > 0)
    notes.push_back(concat(finder_.moved(),
                           " files are not at the paths that name them, and were found by the last "
                           "folders of these"));
}

Result<void> cameras::LeftOut::add(Error why) {
  if (why.code != ErrorCode::not_found && why.code != ErrorCode::bad_file &&
      why.code != ErrorCode::unsupported)
    return tl::unexpected(std::move(why));
  Reason& reason = reasons_[why.code];
  if (reason.count++ == 0) reason.first = why.message;
  if (!first_) first_ = std::move(why);
  return {};
}

Result<void> cameras::LeftOut::settle(std::size_t remaining,
                                      std::vector<std::string>& notes) const {
  std::size_t total = remaining;
  for (const auto& [code, reason] : reasons_) total += reason.count;
  if (first_ && remaining < 2) {
    Error error = *first_;
    if (total > 1)
      error.message +=
          concat("; of ", total, " pictures, ", remaining, " can be used, and 2 are needed");
    return tl::unexpected(std::move(error));
  }
  for (const auto& [code, reason] : reasons_)
    notes.push_back(concat(reason.count, " of ", total, " pictures are left out: ", reason.first,
                           reason.count > 1 ? "; and so on" : ""));
  return {};
}

Result<PictureSet> read_pictures(const std::string& path) try {
  std::error_code ignored;
  auto set = SLF_TRY(fs::is_directory(path, ignored) ? read_folder(path) : read_cameras(path));
  std::ranges::stable_sort(set.pictures, {}, &Picture::name);
  const auto again =
      std::unique(set.pictures.begin(), set.pictures.end(),
                  [](const Picture& a, const Picture& b) { return a.file == b.file; });
  if (const auto count = set.pictures.end() - again; count > 0)
    set.notes.push_back(
        concat(count, " pictures are there twice: only the first camera of each is used"));
  set.pictures.erase(again, set.pictures.end());
  SLF_TRY(cameras::check_sizes(set));
  return set;
} catch (...) {
  return tl::unexpected(error_of_exception());
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
    picture.lens = cameras::pinhole_lens(
        width, height, fitted_fov(sphere, distance * sphere.radius, width, height));
    pictures.push_back(std::move(picture));
  }
  return pictures;
}

}  // namespace slf
