// transforms.json, as instant-ngp, nerfstudio and Blender's exporters write it: cameras look along
// -z with y up, and transform_matrix takes camera space to the world.
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numbers>

#include "base/try.h"
#include "source/pictures/cameras.h"

namespace slf::cameras {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr double kMaxNumber = 1e12;

std::optional<double> number_in(const Json& json, const char* key) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_number()) return std::nullopt;
  return found->get<double>();
}

std::string text_in(const Json& json, const char* key) {
  const auto found = json.find(key);
  return found != json.end() && found->is_string() ? found->get<std::string>() : "";
}

class Reader {
 public:
  Reader(const Json& root, const std::string& name, const std::string& folder)
      : root_(root), name_(name), finder_(folder) {}

  Result<Picture> picture(const Json& frame, std::size_t number) {
    Picture picture;
    picture.name = text_in(frame, "file_path");
    const std::string place = name_ + ": frame " + std::to_string(number) +
                              (picture.name.empty() ? "" : " (" + picture.name + ")");
    if (picture.name.empty()) return bad_file(place, "expected a member \"file_path\"");
    picture.file = finder_.find(picture.name);
    for (const auto& [key, file] : {std::pair{"mask_path", &picture.mask},
                                    {"depth_file_path", &picture.depth},
                                    {"depth_path", &picture.depth}})
      if (const std::string stated = text_in(frame, key); !stated.empty())
        if (auto found = finder_.find(stated); found != picture.file) *file = std::move(found);
    SLF_TRY(set_place(frame, place, picture));
    SLF_TRY(set_lens(frame, place, picture));
    return picture;
  }

  /// What a person should know of the pictures. Errors as LeftOut::settle().
  [[nodiscard]] Result<void> settle(PictureSet& set) const {
    finder_.add_notes(set.notes);
    return left_out_.settle(set.pictures.size(), set.notes);
  }

 private:
  /// Member of the frame or, if it has none, of the file.
  std::optional<double> number(const Json& frame, const char* key) const {
    const auto own = number_in(frame, key);
    return own ? own : number_in(root_, key);
  }

  static Result<void> set_place(const Json& frame, const std::string& place, Picture& picture) {
    const auto matrix = frame.find("transform_matrix");
    const auto bad = [&](const auto&... why) {
      return bad_file(place, "transform_matrix ", why...);
    };
    if (matrix == frame.end() || !matrix->is_array() || matrix->size() < 3 || matrix->size() > 4)
      return bad("is missing or has not 4 rows");
    glm::dmat4 m(1.0);  // m[column][row]
    for (std::size_t row = 0; row < matrix->size(); ++row) {
      const Json& numbers = (*matrix)[row];
      if (!numbers.is_array() || numbers.size() != 4) return bad("has a row of not 4 numbers");
      for (std::size_t column = 0; column < 4; ++column) {
        const double value = numbers[column].is_number() ? numbers[column].get<double>() : NAN;
        if (!(std::abs(value) < kMaxNumber)) return bad("has a number that is not finite");
        m[static_cast<int>(column)][static_cast<int>(row)] = value;
      }
    }
    const glm::dmat3 turn(m);
    const double volume = glm::determinant(turn);
    if (!(std::abs(volume) > 1e-12)) return bad("is singular");
    if (volume < 0)
      return bad("mirrors the world (its determinant is ", volume,
                 "); expected a rotation: the sign of one axis is wrong");
    const double scale = std::cbrt(volume);
    const glm::dmat3 axes = turn / scale;
    const glm::dmat3 product = glm::transpose(axes) * axes;
    double skew = 0;
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) skew = std::max(skew, std::abs(product[c][r] - (c == r ? 1 : 0)));
    if (!(skew < 0.01))
      return bad("is not rigid: its axes are not perpendicular or not equally long (by ", skew,
                 "); expected rotation and translation");
    // Axes are made exactly orthonormal.
    const glm::dvec3 right = glm::normalize(axes[0]);
    const glm::dvec3 up = glm::normalize(axes[1] - glm::dot(axes[1], right) * right);
    picture.axes = glm::dmat3(right, -up, -glm::cross(right, up));
    picture.eye = glm::dvec3(m[3]);
    return {};
  }

  /// Leaves the size at 0 if it is not stated and the picture cannot be read.
  Result<void> set_lens(const Json& frame, const std::string& place, Picture& picture) {
    Lens& lens = picture.lens;
    const auto w = number(frame, "w"), h = number(frame, "h");
    if (w && h) {
      if (!(*w >= 1 && *h >= 1 && *w <= 65536 && *h <= 65536))
        return bad_file(place, "a size of ", *w, "x", *h, " pixels; expected 1 to 65536");
      lens.width = static_cast<std::uint32_t>(*w);
      lens.height = static_cast<std::uint32_t>(*h);
    } else {
      auto size = size_of(name_, picture);
      if (!size) return left_out_.add(std::move(size.error()));
      lens.width = size->width;
      lens.height = size->height;
    }
    const auto focal = [&](const std::string& axis, std::uint32_t side) -> std::optional<double> {
      // An own angle precedes a common length.
      for (const Json* from : {&frame, &root_}) {
        if (const auto degrees = number_in(*from, (axis + "_fov").c_str()))  // instant-ngp
          return side / 2.0 / std::tan(*degrees * std::numbers::pi / 360);
        if (const auto f = number_in(*from, ("fl_" + axis).c_str())) return f;
        if (const auto a = number_in(*from, ("camera_angle_" + axis).c_str()))
          return *a < std::numbers::pi ? side / 2.0 / std::tan(*a / 2) : 0;
      }
      return std::nullopt;
    };
    const auto fx = focal("x", lens.width), fy = focal("y", lens.height);
    if (!fx && !fy)
      return bad_file(
          place, "no focal length; expected \"fl_x\" in pixels or \"camera_angle_x\" in radians");
    lens.fx = fx.value_or(fy.value_or(0));
    lens.fy = fy.value_or(lens.fx);
    lens.cx = number(frame, "cx").value_or(lens.width / 2.0);
    lens.cy = number(frame, "cy").value_or(lens.height / 2.0);
    for (const double f : {lens.fx, lens.fy})
      if (!(f > 0 && f < kMaxNumber))
        return bad_file(place, "a focal length of ", f,
                        " pixels; expected a number above 0, and an angle in radians");
    std::string model = text_in(frame, "camera_model");
    if (model.empty()) model = text_in(root_, "camera_model");
    const auto flag = [](const Json& json) {
      const auto found = json.find("is_fisheye");
      return found != json.end() && found->is_boolean() && found->get<bool>();
    };
    lens.fisheye = model == "OPENCV_FISHEYE" || flag(frame) || flag(root_);
    if (!model.empty() && !lens.fisheye && model != "OPENCV" && model != "PINHOLE" &&
        model != "SIMPLE_PINHOLE" && model != "SIMPLE_RADIAL" && model != "RADIAL")
      return unsupported(place, "camera model ", model,
                         "; perspective (OPENCV, PINHOLE) and OPENCV_FISHEYE are read");
    const auto set = [&](const char* key, double& to) { to = number(frame, key).value_or(0); };
    set("k1", lens.k[0]), set("k2", lens.k[1]), set("k3", lens.k[2]), set("k4", lens.k[3]);
    set("p1", lens.p[0]), set("p2", lens.p[1]);
    for (const double value :
         {lens.cx, lens.cy, lens.k[0], lens.k[1], lens.k[2], lens.k[3], lens.p[0], lens.p[1]})
      if (!(std::abs(value) < kMaxNumber))
        return bad_file(place, "a number of the lens is not finite");
    lens.finish();
    return {};
  }

  const Json& root_;
  const std::string& name_;
  PictureFinder finder_;
  LeftOut left_out_;
};

}  // namespace

Result<PictureSet> parse_transforms(std::string_view text, const std::string& name,
                                    const std::string& folder) {
  constexpr bool kThrows = false, kCommentsAllowed = true;  // as in instant-ngp
  const Json root = Json::parse(text, nullptr, kThrows, kCommentsAllowed);
  if (!root.is_object() || !root.contains("frames") || !root["frames"].is_array())
    return bad_file(name, "expected JSON with an array \"frames\", as in transforms.json");
  const Json& frames = root["frames"];
  if (frames.empty()) return bad_file(name, "has no frames");
  if (frames.size() > kMaxPictures)
    return unsupported(name, frames.size(), " frames; up to ", kMaxPictures, " are read");
  PictureSet set;
  set.source = name;
  Reader reader(root, name, folder);
  for (std::size_t k = 0; k < frames.size(); ++k) {
    auto picture = SLF_TRY(reader.picture(frames[k], k));
    if (picture.lens.width > 0) set.pictures.push_back(std::move(picture));
  }
  SLF_TRY(reader.settle(set));
  for (const char* ignored : {"aabb_scale", "scale", "offset"})
    if (root.contains(ignored))
      set.notes.push_back(
          std::string(ignored) +
          " is ignored: cameras stay where the matrices put them, and the sphere is fitted");
  return set;
}

}  // namespace slf::cameras

namespace slf {

std::string transforms_json(const std::vector<Picture>& pictures, const std::string& folder) {
  using Json = nlohmann::ordered_json;
  namespace fs = std::filesystem;
  Json root = Json::object();  // a null value would be left broken where memory ends
  root["frames"] = Json::array();
  for (const Picture& picture : pictures) {
    const auto row = [&](int r) {
      Json numbers = Json::array();
      for (const double number :
           {picture.axes[0][r], -picture.axes[1][r], -picture.axes[2][r], picture.eye[r]})
        numbers.push_back(number);
      return numbers;
    };
    const auto relative = [&](const std::string& path) {
      const std::string shorter = fs::path(path).lexically_relative(folder).string();
      return shorter.empty() || shorter.starts_with("..") ? path : shorter;
    };
    const Lens& lens = picture.lens;
    Json frame = Json::object();
    frame["file_path"] = picture.file.empty() ? picture.name : relative(picture.file);
    if (!picture.mask.empty()) frame["mask_path"] = relative(picture.mask);
    if (!picture.depth.empty()) frame["depth_file_path"] = relative(picture.depth);
    frame["w"] = lens.width, frame["h"] = lens.height;
    frame["fl_x"] = lens.fx, frame["fl_y"] = lens.fy;
    frame["cx"] = lens.cx, frame["cy"] = lens.cy;
    if (lens.fisheye) frame["is_fisheye"] = true;
    const char* names[] = {"k1", "k2", "k3", "k4"};
    for (std::size_t k = 0; k < 4; ++k)
      if (lens.k[k] != 0) frame[names[k]] = lens.k[k];
    if (lens.p[0] != 0) frame["p1"] = lens.p[0];
    if (lens.p[1] != 0) frame["p2"] = lens.p[1];
    Json& matrix = frame["transform_matrix"] = Json::array();
    for (int r = 0; r < 3; ++r) matrix.push_back(row(r));
    matrix.push_back({0, 0, 0, 1});
    root["frames"].push_back(std::move(frame));
  }
  return root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace slf
