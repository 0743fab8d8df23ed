// Cinema databases, specification D: a table data.csv that names pictures by their parameters. As
// ParaView's phi-theta camera writes them: azimuth and elevation, in degrees, of a camera that is
// turned around its focal point, from the front with z up. Nothing states the distance, so the
// world is chosen: the sphere around the object has radius 1, and fits the pictures.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "base/ascii.h"
#include "base/try.h"
#include "source/pictures/cameras.h"
#include "source/volume/io.h"

namespace slf::cameras {
namespace {

constexpr double kViewAngle = 30;  // degrees, of the height: the default of VTK's cameras
constexpr std::size_t kMaxColumns = 1000;

using Row = std::vector<std::string>;

/// What the columns of a table hold.
struct Columns {
  std::size_t count = 0;
  std::optional<std::size_t> phi, theta, file, depth, angle;
  std::vector<std::size_t> parameters;  ///< all others
};

Columns columns_of(const Row& names) {
  Columns columns;
  columns.count = names.size();
  for (std::size_t k = 0; k < names.size(); ++k) {
    const std::string name = lower_case(names[k]);
    const bool file = name.starts_with("file");
    const bool depth = file && (name.find("depth") != std::string::npos || name.ends_with("_z"));
    auto& known = name == "phi"          ? columns.phi
                  : name == "theta"      ? columns.theta
                  : name == "view_angle" ? columns.angle
                  : depth                ? columns.depth
                                         : columns.file;
    const bool named = name == "phi" || name == "theta" || name == "view_angle" || file;
    if (named && !known) known = k;
    if (!named) columns.parameters.push_back(k);
  }
  return columns;
}

std::optional<double> number_in(const std::string& cell) {
  const auto value = volume_io::parse_number(cell);
  return value && std::abs(*value) < 1e6 ? value : std::nullopt;
}

/// Turns a camera at the front by `phi` around the vertical axis and then by `theta` upwards, as
/// vtkCamera's Azimuth() and Elevation() do.
void set_place(double phi, double theta, double distance, Picture& picture) {
  const double a = phi * std::numbers::pi / 180, e = theta * std::numbers::pi / 180;
  const glm::dvec3 level(std::sin(a), -std::cos(a), 0), up(0, 0, 1);
  const glm::dvec3 toward = std::cos(e) * level + std::sin(e) * up;
  const glm::dvec3 down = std::sin(e) * level - std::cos(e) * up;
  picture.eye = distance * toward;
  picture.axes = glm::dmat3(glm::cross(down, -toward), down, -toward);
}

}  // namespace

Result<PictureSet> parse_cinema(std::string_view text, const std::string& name,
                                const std::string& folder) {
  std::size_t at = 0, line = 1;
  const auto next_row = [&] {  // empty at the end
    Row row;
    while (at < text.size() && (row.empty() || (row.size() == 1 && row[0].empty())))
      row = volume_io::next_row(text, at, line);
    return row.size() == 1 && row[0].empty() ? Row() : row;
  };
  const Row names = next_row();
  if (names.size() > kMaxColumns)
    return unsupported(name, names.size(), " columns; up to ", kMaxColumns, " are read");
  const Columns columns = columns_of(names);
  if (!columns.phi || !columns.theta || !columns.file)
    return bad_file(name, "expected a Cinema database with columns phi, theta and FILE");
  PictureSet set;
  set.source = name;
  std::vector<std::set<std::string>> values(columns.parameters.size());
  Row first;
  PictureFinder finder(folder);
  LeftOut left_out;
  std::size_t number = 1, others = 0;
  for (Row row = next_row(); !row.empty(); row = next_row()) {
    const std::string place = name + ": row " + std::to_string(++number);
    if (row.size() != columns.count)
      return bad_file(place, row.size(), " cells; expected ", columns.count);
    if (first.empty()) first = row;
    bool same = true;  // one picture for each direction: of the first row's parameters
    for (std::size_t k = 0; k < columns.parameters.size(); ++k) {
      const std::string& cell = row[columns.parameters[k]];
      values[k].insert(cell);
      same = same && cell == first[columns.parameters[k]];
    }
    if (!same) {
      ++others;
      continue;
    }
    if (set.pictures.size() >= kMaxPictures)
      return unsupported(name, "more than ", kMaxPictures, " pictures");
    const auto phi = number_in(row[*columns.phi]), theta = number_in(row[*columns.theta]);
    const auto angle = columns.angle ? number_in(row[*columns.angle]) : kViewAngle;
    if (!phi || !theta || !angle || !(*angle > 0.01 && *angle < 179))
      return bad_file(place, "phi, theta or view_angle is no number of degrees");
    Picture picture;
    picture.name = row[*columns.file];
    picture.file = finder.find(picture.name);
    if (columns.depth && !row[*columns.depth].empty())
      picture.depth = finder.find(row[*columns.depth]);
    auto size = size_of(name, picture);
    if (!size) {
      SLF_TRY(left_out.add(std::move(size.error())));
      continue;
    }
    picture.lens = pinhole_lens(size->width, size->height, *angle);
    const Lens& lens = picture.lens;
    // ParaView puts the camera where the sphere around the data just fits the narrower side.
    const double narrow = std::atan(std::min(lens.width, lens.height) / 2.0 / lens.fy);
    set_place(*phi, *theta, 1 / std::sin(narrow), picture);
    set.pictures.push_back(std::move(picture));
  }
  finder.add_notes(set.notes);
  SLF_TRY(left_out.settle(set.pictures.size(), set.notes));
  if (set.pictures.empty()) return bad_file(name, "has no pictures");
  set.notes.push_back(
      "the database states no distances: the sphere around the object is taken to have radius 1 "
      "and to fit the pictures" +
      std::string(columns.angle ? "" : ", and the view angle to be 30 degrees"));
  if (others > 0) {
    std::string chosen;
    for (std::size_t k = 0; k < values.size(); ++k)
      if (values[k].size() > 1)
        chosen += (chosen.empty() ? "" : ", ") + names[columns.parameters[k]] + " " +
                  first[columns.parameters[k]];
    set.notes.push_back(std::to_string(others) + " pictures with other parameters than " + chosen +
                        " are left out: a table of other rows chooses those");
  }
  return set;
}

}  // namespace slf::cameras
