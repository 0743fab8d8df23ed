// COLMAP's sparse models, binary and text. Cameras look along +z with y down; a picture's rotation
// and translation take the world to camera space. Newer versions add files of rigs and frames,
// which repeat what the files of images say.
#include <bit>
#include <cmath>
#include <filesystem>
#include <glm/gtc/quaternion.hpp>
#include <map>
#include <utility>

#include "base/file.h"
#include "base/try.h"
#include "source/pictures/cameras.h"
#include "source/volume/io.h"

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

/// The records of a file, one after another: numbers of fixed sizes, or lines of words.
class Records {
 public:
  Records(ByteSpan bytes, bool as_text) : rest_(chars_of(bytes)), as_text_(as_text) {
    if (!as_text_) left_ = integer(8);
  }

  /// Whether all of the record was there so far.
  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] std::string_view line() const { return line_; }

  /// Goes to the next record. False: there is none.
  bool next() {
    if (as_text_) return next_text(false);
    return ok_ && left_ > 0 && left_-- > 0;
  }
  /// Goes to the next line that is no comment.
  bool next_text(bool empty_ones) {
    ok_ = true;
    while (!rest_.empty()) {
      line_ = next_line(rest_);
      if (!line_.starts_with('#') && (empty_ones || !line_.empty())) return true;
    }
    return false;
  }
  std::string_view word() {
    line_ = trim(line_);
    const std::string_view word = line_.substr(0, line_.find_first_of(" \t"));
    line_.remove_prefix(word.size());
    return word;
  }
  /// An integer without sign, of so many bytes.
  std::uint64_t integer(std::size_t bytes) {
    if (as_text_) {
      const auto value = volume_io::parse_integer(word());
      ok_ = ok_ && value && *value >= 0;
      return ok_ ? static_cast<std::uint64_t>(*value) : 0;
    }
    const std::string_view stored = take(bytes);
    std::uint64_t value = 0;
    for (std::size_t k = stored.size(); k-- > 0;)
      value = value << 8 | static_cast<unsigned char>(stored[k]);
    return value;
  }
  double real() {
    if (!as_text_) return std::bit_cast<double>(integer(8));
    const auto value = volume_io::parse_number(word());
    ok_ = ok_ && value;
    return value.value_or(0);
  }
  /// Text up to a zero, or the end of the line.
  std::string name() {
    if (as_text_) return std::string(trim(std::exchange(line_, {})));
    const std::string_view text = take(rest_.find('\0'));
    take(1);
    return std::string(text);
  }
  /// The next bytes, or none if there are fewer.
  std::string_view take(std::uint64_t bytes) {
    ok_ = ok_ && bytes <= rest_.size();
    const std::string_view taken = ok_ ? rest_.substr(0, bytes) : std::string_view();
    rest_.remove_prefix(taken.size());
    return taken;
  }
  /// Skips a list of items of so many bytes.
  void skip_list(std::uint64_t bytes) {
    const std::uint64_t count = integer(8);
    take(count > rest_.size() / bytes ? rest_.size() + 1 : count * bytes);
  }

 private:
  std::string_view rest_, line_;
  bool as_text_, ok_ = true;
  std::uint64_t left_ = 0;
};

Result<void> add_camera(const std::string& file, std::uint64_t id, std::size_t model,
                        std::uint64_t width, std::uint64_t height, const std::vector<double>& p,
                        std::map<std::uint64_t, Lens>& lenses) {
  if (width < 1 || height < 1 || width > 65536 || height > 65536)
    return bad_file(file, "camera ", id, ": a size of ", width, "x", height,
                    " pixels; expected 1 to 65536");
  for (const double value : p)
    if (!(std::abs(value) < 1e12))
      return bad_file(file, "camera ", id, ": a parameter is not finite");
  const Lens lens = make_lens(model, width, height, p);
  if (!(lens.fx > 0 && lens.fy > 0))
    return bad_file(file, "camera ", id, ": focal lengths ", lens.fx, " and ", lens.fy,
                    "; expected above 0");
  lenses[id] = lens;
  return {};
}

tl::unexpected<Error> unknown_model(const std::string& file, std::uint64_t id,
                                    const std::string& model) {
  return unsupported(file, "camera ", id, ": model ", model,
                     "; known: ", joined(kModels, ", ", &Model::name));
}

Result<std::map<std::uint64_t, Lens>> read_lenses(const ColmapModel& model) {
  const std::string file = model.folder + (model.text ? "/cameras.txt" : "/cameras.bin");
  std::map<std::uint64_t, Lens> lenses;
  Records in(model.cameras, model.text);
  const auto truncated = [&] {
    return bad_file(file, "ends within a camera, after ", lenses.size());
  };
  while (in.next()) {
    const auto id = in.integer(4);
    std::uint64_t number = 0;
    std::string name;
    if (model.text) {
      name = in.word();
      while (number < std::size(kModels) && kModels[number].name != name) ++number;
    } else {
      number = in.integer(4);
      name = "number " + std::to_string(number);
    }
    const auto width = in.integer(8), height = in.integer(8);
    if (!in.ok()) return truncated();
    if (number >= std::size(kModels)) return unknown_model(file, id, name);
    std::vector<double> p(kModels[number].parameters);
    for (double& value : p) value = in.real();
    if (!in.ok()) return truncated();
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
  // Rows of the rotation are the camera's axes in the world.
  picture.axes = glm::transpose(
      glm::mat3_cast(glm::dquat(qw / length, qx / length, qy / length, qz / length)));
  picture.eye = -(picture.axes * glm::dvec3(tx, ty, tz));
  return true;
}

/// Whether a line of images.txt is the first one of an image: its tenth word is a name, or the last
/// one. Lines of points have three numbers each.
bool begins_image(std::string_view line) {
  const auto words = volume_io::words(line);
  return words.size() == 10 || (words.size() > 10 && !volume_io::parse_number(words[9]));
}

Result<void> read_images(const ColmapModel& model, const std::string& image_folder,
                         const std::map<std::uint64_t, Lens>& lenses, PictureSet& set) {
  const std::string file = model.folder + (model.text ? "/images.txt" : "/images.bin");
  Records in(model.images, model.text);
  const auto truncated = [&] {
    return bad_file(file, "ends within an image, after ", set.pictures.size());
  };
  const auto add = [&](const std::array<double, 7>& place, std::uint64_t camera,
                       const std::string& name) -> Result<void> {
    Picture picture;
    picture.name = name;
    picture.file = (fs::path(image_folder) / name).lexically_normal().string();
    const auto lens = lenses.find(camera);
    if (lens == lenses.end())
      return bad_file(file, name, ": has camera ", camera, ", which the file of cameras has not");
    picture.lens = lens->second;
    if (!set_place(place, picture))
      return bad_file(file, name, ": rotation or translation is not finite, or the rotation is 0");
    if (set.pictures.size() >= kMaxPictures)
      return unsupported(file, "more than ", kMaxPictures, " images");
    set.pictures.push_back(std::move(picture));
    return {};
  };
  std::array<double, 7> place{};
  for (bool more = in.next(); more;) {
    in.integer(4);
    for (double& value : place) value = in.real();
    const auto camera = in.integer(4);
    const std::string name = in.name();
    if (!model.text) in.skip_list(24);
    if (!in.ok() || (model.text && name.empty())) return truncated();
    SLF_TRY(add(place, camera, name));
    // In text, a line of points follows, which may be empty. Some programs leave it out.
    more = model.text && in.next_text(true) && begins_image(in.line()) ? true : in.next();
  }
  if (!in.ok()) return truncated();
  return {};
}

/// Points are only hints, so damaged ones are left out.
std::vector<glm::dvec3> read_points(const ColmapModel& model) {
  std::vector<glm::dvec3> points;
  Records in(model.points, model.text);
  while (in.next()) {
    in.integer(8);
    const double x = in.real(), y = in.real(), z = in.real();
    if (!model.text) {
      in.take(3 + 8);
      in.skip_list(8);
    }
    if (in.ok() && std::abs(x) < 1e12 && std::abs(y) < 1e12 && std::abs(z) < 1e12)
      points.emplace_back(x, y, z);
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
  if (set.pictures.empty()) return bad_file(model.folder, "the model has no images");
  set.points = read_points(model);
  return set;
}

}  // namespace slf::cameras
