// COLMAP's sparse models, binary and text. Cameras look along +z with y down; a picture's rotation
// and translation take the world to camera space. Newer versions add files of rigs and frames,
// which repeat what the files of images say.
#include <charconv>
#include <cmath>
#include <filesystem>
#include <map>
#include <sstream>

#include "base/file.h"
#include "base/try.h"
#include "field/pictures/cameras.h"

namespace slf::cameras {
namespace {

namespace fs = std::filesystem;

struct Model {
  const char* name;
  std::size_t parameters;
};
/// In the order of COLMAP's numbers.
constexpr Model kModels[] = {{"SIMPLE_PINHOLE", 3},
                             {"PINHOLE", 4},
                             {"SIMPLE_RADIAL", 4},
                             {"RADIAL", 5},
                             {"OPENCV", 8},
                             {"OPENCV_FISHEYE", 8},
                             {"FULL_OPENCV", 12},
                             {"FOV", 5},
                             {"SIMPLE_RADIAL_FISHEYE", 4},
                             {"RADIAL_FISHEYE", 5},
                             {"THIN_PRISM_FISHEYE", 12}};

/// REQUIRES: as many parameters as the model has.
Lens make_lens(std::size_t model, std::uint64_t width, std::uint64_t height,
               const std::vector<double>& p) {
  Lens lens;
  lens.width = static_cast<std::uint32_t>(width);
  lens.height = static_cast<std::uint32_t>(height);
  const std::string_view name = kModels[model].name;
  const bool one_focal = name.starts_with("SIMPLE") || name.starts_with("RADIAL");
  lens.fisheye = name.ends_with("FISHEYE");
  std::size_t at = 0;
  lens.fx = p[at++];
  lens.fy = one_focal ? lens.fx : p[at++];
  lens.cx = p[at++];
  lens.cy = p[at++];
  const auto next = [&] { return at < p.size() ? p[at++] : 0.0; };
  if (name == "FOV") {
    lens.omega = next();
  } else if (name == "OPENCV_FISHEYE" || one_focal) {
    for (double& k : lens.k) k = next();
  } else {
    lens.k[0] = next(), lens.k[1] = next();
    lens.p[0] = next(), lens.p[1] = next();
    if (name == "FULL_OPENCV") {
      lens.k[2] = next();
      for (double& d : lens.d) d = next();
    } else {
      lens.k[2] = next(), lens.k[3] = next();
      lens.s[0] = next(), lens.s[1] = next();
    }
  }
  lens.finish();
  return lens;
}

/// Values one after another: numbers of fixed sizes, or words of lines.
class Input {
 public:
  explicit Input(ByteSpan bytes) : bytes_(bytes) {}

  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] std::size_t left() const { return bytes_.size() - at_; }

  template <std::unsigned_integral T>
  T integer() {
    if (sizeof(T) > left()) return stop<T>();
    const T value = load_le<T>(&bytes_[at_]);
    at_ += sizeof(T);
    return value;
  }
  double real() { return std::bit_cast<double>(integer<std::uint64_t>()); }
  std::string name() {
    std::string text;
    while (left() > 0 && bytes_[at_] != std::byte{0}) text += static_cast<char>(bytes_[at_++]);
    if (left() == 0) return stop<std::string>();
    ++at_;
    return text;
  }
  void skip(std::uint64_t bytes) {
    if (bytes > left())
      stop<int>();
    else
      at_ += bytes;
  }
  /// The next line that is no comment; none at the end.
  std::optional<std::string> line(bool empty_ones) {
    while (at_ < bytes_.size()) {
      std::string text;
      while (at_ < bytes_.size() && bytes_[at_] != std::byte{'\n'})
        text += static_cast<char>(bytes_[at_++]);
      ++at_;
      if (!text.empty() && text.back() == '\r') text.pop_back();
      if (!text.starts_with('#') && (empty_ones || !text.empty())) return text;
    }
    at_ = bytes_.size();
    return std::nullopt;
  }

 private:
  template <class T>
  T stop() {
    ok_ = false;
    at_ = bytes_.size();
    return T{};
  }

  ByteSpan bytes_;
  std::size_t at_ = 0;
  bool ok_ = true;
};

struct Words {
  explicit Words(const std::string& line) : stream(line) { stream.imbue(std::locale::classic()); }
  template <class T>
  T next() {
    T value{};
    stream >> value;
    return value;
  }
  std::istringstream stream;
};

Result<void> add_camera(const std::string& file, std::uint64_t id, std::int64_t model,
                        std::uint64_t width, std::uint64_t height, const std::vector<double>& p,
                        std::map<std::uint64_t, Lens>& lenses) {
  if (width < 1 || height < 1 || width > 65536 || height > 65536)
    return fail(ErrorCode::bad_file, file, ": camera ", id, ": a size of ", width, "x", height,
                " pixels; expected 1 to 65536");
  for (const double value : p)
    if (!(std::abs(value) < 1e12))
      return fail(ErrorCode::bad_file, file, ": camera ", id, ": a parameter is not finite");
  const Lens lens = make_lens(static_cast<std::size_t>(model), width, height, p);
  if (!(lens.fx > 0 && lens.fy > 0))
    return fail(ErrorCode::bad_file, file, ": camera ", id, ": focal lengths ", lens.fx, " and ",
                lens.fy, "; expected above 0");
  lenses[id] = lens;
  return {};
}

tl::unexpected<Error> unknown_model(const std::string& file, std::uint64_t id,
                                    const std::string& model) {
  std::string known;
  for (const Model& m : kModels) known += (known.empty() ? "" : ", ") + std::string(m.name);
  return fail(ErrorCode::unsupported, file, ": camera ", id, ": model ", model, "; known: ", known);
}

Result<std::map<std::uint64_t, Lens>> read_lenses(const ColmapModel& model) {
  const std::string file = model.folder + (model.text ? "/cameras.txt" : "/cameras.bin");
  std::map<std::uint64_t, Lens> lenses;
  Input in(model.cameras);
  const auto truncated = [&] {
    return fail(ErrorCode::bad_file, file, ": ends within a camera, after ", lenses.size());
  };
  if (model.text) {
    while (const auto line = in.line(false)) {
      Words words(*line);
      const auto id = words.next<std::uint64_t>();
      const auto name = words.next<std::string>();
      const auto width = words.next<std::uint64_t>(), height = words.next<std::uint64_t>();
      std::size_t number = 0;
      while (number < std::size(kModels) && kModels[number].name != name) ++number;
      if (!words.stream) return truncated();
      if (number == std::size(kModels)) return unknown_model(file, id, name);
      std::vector<double> p(kModels[number].parameters);
      for (double& value : p) value = words.next<double>();
      if (!words.stream) return truncated();
      SLF_TRY(add_camera(file, id, static_cast<std::int64_t>(number), width, height, p, lenses));
    }
    return lenses;
  }
  const auto count = in.integer<std::uint64_t>();
  for (std::uint64_t k = 0; in.ok() && k < count; ++k) {
    const auto id = in.integer<std::uint32_t>();
    const auto number = in.integer<std::uint32_t>();
    const auto width = in.integer<std::uint64_t>(), height = in.integer<std::uint64_t>();
    if (!in.ok()) break;
    if (number >= std::size(kModels))
      return unknown_model(file, id, "number " + std::to_string(number));
    std::vector<double> p(kModels[number].parameters);
    for (double& value : p) value = in.real();
    if (!in.ok()) break;
    SLF_TRY(add_camera(file, id, number, width, height, p, lenses));
  }
  if (!in.ok()) return truncated();
  return lenses;
}

/// From COLMAP's rotation (w, x, y, z) and translation.
bool set_place(const std::array<double, 7>& place, Picture& picture) {
  for (const double value : place)
    if (!(std::abs(value) < 1e12)) return false;
  const auto [qw, qx, qy, qz, tx, ty, tz] = place;
  const double length = std::sqrt(qw * qw + qx * qx + qy * qy + qz * qz);
  if (!(length > 1e-6)) return false;
  const double w = qw / length, x = qx / length, y = qy / length, z = qz / length;
  // Rows of the rotation are the camera's axes in the world.
  picture.axes =
      glm::dmat3(glm::dvec3(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
                 glm::dvec3(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
                 glm::dvec3(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)));
  picture.eye = -(picture.axes * glm::dvec3(tx, ty, tz));
  return true;
}

/// Whether a line of images.txt is the first one of an image: its tenth word is a name, or the last
/// one. Lines of points have three numbers each.
bool begins_image(const std::string& line) {
  Words words(line);
  std::string word, further;
  for (int k = 0; k < 10; ++k)
    if (word = words.next<std::string>(); word.empty()) return false;
  double number = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
  return error != std::errc() || end != word.data() + word.size() || !(words.stream >> further);
}

Result<void> read_images(const ColmapModel& model, const std::string& image_folder,
                         const std::map<std::uint64_t, Lens>& lenses, PictureSet& set) {
  const std::string file = model.folder + (model.text ? "/images.txt" : "/images.bin");
  Input in(model.images);
  const auto truncated = [&] {
    return fail(ErrorCode::bad_file, file, ": ends within an image, after ", set.pictures.size());
  };
  const auto add = [&](const std::array<double, 7>& place, std::uint64_t camera,
                       const std::string& name) -> Result<void> {
    Picture picture;
    picture.name = name;
    picture.file = (fs::path(image_folder) / name).lexically_normal().string();
    const auto lens = lenses.find(camera);
    if (lens == lenses.end())
      return fail(ErrorCode::bad_file, file, ": ", name, ": has camera ", camera,
                  ", which the file of cameras has not");
    picture.lens = lens->second;
    if (!set_place(place, picture))
      return fail(ErrorCode::bad_file, file, ": ", name,
                  ": rotation or translation is not finite, or the rotation is 0");
    if (set.pictures.size() >= kMaxPictures)
      return fail(ErrorCode::unsupported, file, ": more than ", kMaxPictures, " images");
    set.pictures.push_back(std::move(picture));
    return {};
  };
  std::array<double, 7> place{};
  if (model.text) {
    // An image has two lines; the second one, of points, may be empty. Some programs leave it out.
    for (auto line = in.line(false); line;) {
      Words words(*line);
      words.next<std::uint64_t>();
      for (double& value : place) value = words.next<double>();
      const auto camera = words.next<std::uint64_t>();
      if (!words.stream) return truncated();
      std::string name;
      std::getline(words.stream >> std::ws, name);
      if (name.empty()) return truncated();
      SLF_TRY(add(place, camera, name));
      line = in.line(true);
      if (!line || !begins_image(*line)) line = in.line(false);
    }
    return {};
  }
  const auto count = in.integer<std::uint64_t>();
  for (std::uint64_t k = 0; in.ok() && k < count; ++k) {
    in.integer<std::uint32_t>();
    for (double& value : place) value = in.real();
    const auto camera = in.integer<std::uint32_t>();
    const std::string name = in.name();
    const auto points = in.integer<std::uint64_t>();
    if (!in.ok() || points > in.left() / 24) return truncated();
    in.skip(points * 24);
    SLF_TRY(add(place, camera, name));
  }
  if (!in.ok()) return truncated();
  return {};
}

/// Points are only hints, so damaged ones are left out.
std::vector<glm::dvec3> read_points(const ColmapModel& model) {
  std::vector<glm::dvec3> points;
  const auto add = [&](const glm::dvec3& p) {
    if (std::abs(p.x) < 1e12 && std::abs(p.y) < 1e12 && std::abs(p.z) < 1e12) points.push_back(p);
  };
  Input in(model.points);
  if (model.text) {
    while (const auto line = in.line(false)) {
      Words words(*line);
      words.next<std::uint64_t>();
      const auto x = words.next<double>(), y = words.next<double>(), z = words.next<double>();
      if (words.stream) add({x, y, z});
    }
    return points;
  }
  const auto count = in.integer<std::uint64_t>();
  for (std::uint64_t k = 0; in.ok() && k < count; ++k) {
    in.integer<std::uint64_t>();
    const double x = in.real(), y = in.real(), z = in.real();
    in.skip(3 + 8);
    const auto track = in.integer<std::uint64_t>();
    if (!in.ok() || track > in.left() / 8) break;
    in.skip(track * 8);
    add({x, y, z});
  }
  return points;
}

}  // namespace

ColmapForm colmap_form(const std::string& folder) {
  std::error_code ignored;
  const auto has = [&](const char* name) {
    return fs::is_regular_file(fs::path(folder) / name, ignored);
  };
  if (has("cameras.bin") && has("images.bin")) return ColmapForm::binary;
  if (has("cameras.txt") && has("images.txt")) return ColmapForm::text;
  return ColmapForm::none;
}

Result<ColmapModel> read_colmap(const std::string& folder) {
  ColmapModel model;
  model.folder = folder;
  model.text = colmap_form(folder) == ColmapForm::text;
  const std::string extension = model.text ? ".txt" : ".bin";
  for (const auto& [name, bytes] : {std::pair{"/cameras", &model.cameras},
                                    {"/images", &model.images},
                                    {"/points3D", &model.points}}) {
    const std::string file = std::string(folder).append(name).append(extension);
    std::error_code ignored;
    if (bytes == &model.points && !fs::exists(file, ignored)) continue;
    auto read = SLF_TRY(read_file(file, kMaxFileBytes));
    *bytes = std::move(read);
  }
  return model;
}

Result<PictureSet> parse_colmap(const ColmapModel& model, const std::string& image_folder) {
  const auto lenses = SLF_TRY(read_lenses(model));
  PictureSet set;
  set.source = model.folder;
  SLF_TRY(read_images(model, image_folder, lenses, set));
  if (set.pictures.empty())
    return fail(ErrorCode::bad_file, model.folder, ": the model has no images");
  set.points = read_points(model);
  return set;
}

}  // namespace slf::cameras
