// Pictures with known cameras, and the scene that they show.
//
// read_pictures() reads cameras as other programs write them: transforms.json of instant-ngp,
// nerfstudio and Blender, COLMAP's sparse models, and Cinema databases. make_picture_scene() makes
// a Scene of them, so that a field can be built from pictures instead of a volume.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slf/camera.h"
#include "slf/error.h"
#include "slf/image.h"
#include "slf/progress.h"
#include "slf/scene.h"
#include "slf/shape.h"

namespace slf {

/// How a camera projects directions to its picture. Directions are in camera space: x to the right,
/// y down, z forward. Pixel (x, y) has its centre at (x + 0.5, y + 0.5).
///
/// A direction is first mapped to the plane: to (x, y) / z by a perspective lens, and to an angle
/// from the axis, in radians, by a fisheye. There it is distorted:
///   factor = (1 + k0 r² + k1 r⁴ + k2 r⁶ + k3 r⁸) / (1 + d0 r² + d1 r⁴ + d2 r⁶)
///   x' = x factor + 2 p0 x y + p1 (r² + 2 x²) + s0 r²
///   y' = y factor + 2 p1 x y + p0 (r² + 2 y²) + s1 r²
/// which covers the lenses of OpenCV and COLMAP. `omega` is that of COLMAP's FOV lens; 0: none.
struct Lens {
  bool fisheye = false;
  std::uint32_t width = 0, height = 0;  ///< pixels
  double fx = 0, fy = 0;                ///< focal lengths, pixels
  double cx = 0, cy = 0;                ///< principal point, pixels
  std::array<double, 4> k{};            ///< radial
  std::array<double, 3> d{};            ///< radial, in the denominator
  std::array<double, 2> p{};            ///< tangential
  std::array<double, 2> s{};            ///< thin prism
  double omega = 0;                     ///< radians

  [[nodiscard]] bool distorted() const;
  /// The place in the picture, in pixels, of a direction in camera space; none if it is behind the
  /// camera or further from the axis than the corners of the picture.
  [[nodiscard]] std::optional<glm::dvec2> project(const glm::dvec3& direction) const;
  /// The direction of a place in the picture. z is 1, unless a fisheye sees backwards.
  [[nodiscard]] glm::dvec3 direction(const glm::dvec2& pixel) const;
  /// Computes what project() needs. Call it after changing any other member.
  void finish();

  double max_radius2 = 0;  ///< in the undistorted plane; set by finish()
};

/// One picture and its camera.
struct Picture {
  std::string name;   ///< as the file of cameras calls it
  std::string file;   ///< path of the picture
  std::string mask;   ///< path of a mask, not 0 where the object is; empty: alpha, if there is any
  std::string depth;  ///< path of a picture of depths; empty: Z in `file`, if there is any
  Lens lens;
  glm::dmat3 axes{1.0};  ///< columns: right, down and forward, in the world; orthonormal
  glm::dvec3 eye{0.0};   ///< world

  /// The direction in camera space of a point, with the length of the distance.
  [[nodiscard]] glm::dvec3 to_camera(const glm::dvec3& world) const { return (world - eye) * axes; }
};

struct PictureSet {
  std::string source;               ///< the file or folder that named the cameras
  std::vector<std::string> models;  ///< the files in that folder that were read
  std::vector<Picture> pictures;    ///< in the order of their names
  std::vector<glm::dvec3> points;   ///< points of the object that the source states; mostly none
  std::vector<std::string> notes;   ///< what people should know

  /// All files that it consists of: those of cameras, pictures, masks and depths.
  [[nodiscard]] std::vector<std::string> files() const;
};

/// Reads cameras, not pictures. `path` is a transforms.json or another JSON file of its kind, the
/// table (.csv) of a Cinema database of specification D, or a folder that has transforms.json,
/// transforms_train.json, data.csv, or a COLMAP model (cameras, images and points3D as .bin or
/// .txt, in the folder, in sparse or in sparse/0, with the pictures in the folder images). Input is
/// untrusted; the sizes of pictures are compared with those of cameras. Pictures that are missing,
/// damaged or of another shape than their camera are left out, with a note, as by other readers.
/// not_found: there is no such file, or fewer than two of the pictures are there. io: cannot be
/// read. bad_file: damaged; a matrix is singular or not rigid. unsupported: an unknown kind of
/// camera. The message names the file, the picture and what was expected.
[[nodiscard]] Result<PictureSet> read_pictures(const std::string& path);

/// The point that the optical axes of all cameras pass nearest; none if all look the same way.
[[nodiscard]] std::optional<glm::dvec3> focus_of(const std::vector<Picture>& pictures);

/// Reads the cameras of a JSON or .csv file of that kind. Pictures of JSON need not exist if it
/// states sizes.
[[nodiscard]] Result<PictureSet> read_cameras(const std::string& path);

/// Cameras as transforms.json in instant-ngp's form. Paths of pictures are relative to `folder` if
/// they are below it. Bytes of paths that are not UTF-8 become U+FFFD.
[[nodiscard]] std::string transforms_json(const std::vector<Picture>& pictures,
                                          const std::string& folder);

/// `count` undistorted cameras around a sphere at `distance` radii, well spread (a Fibonacci
/// lattice), such that the sphere fits the picture. They are named "0000" and so on.
[[nodiscard]] std::vector<Picture> spread_cameras(const Sphere& sphere, double distance,
                                                  std::uint32_t count, std::uint32_t width,
                                                  std::uint32_t height);

/// What a depth in a picture measures.
enum class DepthKind : std::uint8_t {
  unknown,  ///< z or ray, found by comparing pictures; estimated where there are no depths
  z,        ///< distance along the optical axis
  ray,      ///< distance from the eye
  inverse,  ///< 1 / z
  none,     ///< depths are neither read nor estimated: the silhouettes alone give the surface
};

struct PictureSceneOptions {
  DepthKind depth = DepthKind::unknown;
  double depth_scale = 1;          ///< world units of one unit in depth pictures
  std::uint32_t holdout = 0;       ///< leaves out every `holdout`-th picture, from the first on
  std::optional<Sphere> sphere{};  ///< none: found from cameras and content
  /// Of pictures without alpha and masks: rays that do not meet the object get the colour of what
  /// is behind it, as if that were painted on the far side of the sphere. Otherwise they stay
  /// empty.
  bool keep_background = false;
  std::uint32_t voxels = 256;  ///< along an edge of the grid that holds the object's surface
  std::uint64_t memory = std::uint64_t{1}
                         << 30;  ///< bytes of decoded pictures, and of the search for depths
  /// A file that keeps estimated depths, which take most of the time, for later calls with the same
  /// pictures and options; empty: none. An older one of slf is replaced.
  std::string depth_cache{};
  unsigned threads = 0;                               ///< 0: all
  ProgressCallback progress{};                        ///< counts pictures
  std::function<void(const std::string&)> on_note{};  ///< gets what people should know
};

/// Where estimated depths of a set are kept if nothing else is said: beside the file or folder that
/// named the cameras.
[[nodiscard]] std::string depth_cache_of(const PictureSet& set);

/// Whether `holdout` leaves out the picture with this number.
[[nodiscard]] inline bool is_held_out(std::size_t picture, std::uint32_t holdout) {
  return holdout != 0 && picture % holdout == 0;
}

/// A scene made of pictures (unstructured lumigraph: Buehler et al. 2001). The surface of the
/// object is found first: by the silhouettes of all pictures (visual hull), refined by depths,
/// which come from the pictures or from comparing them (plane sweep). A ray is aimed at the point
/// where it meets that surface, or passes it nearest. The colour is blended from the pictures of
/// the nearest directions that see this point; weights are continuous. Nothing outside the sphere
/// is seen.
/// Thread-safety: any thread. Pictures are decoded when needed and kept, the least recently used
/// leave first; the result depends neither on the memory nor on the threads. A picture that cannot
/// be read any more throws std::runtime_error, which build_field() returns as an error.
/// usage: no pictures, or no sphere can be found; a background is to be kept, but masks hide it;
/// `depth_cache` is a file of something else. failed: nothing is visible. cancelled: stopped by
/// `progress`. Else errors as read_image(). That depths cannot be kept is a note.
[[nodiscard]] Result<std::unique_ptr<Scene>> make_picture_scene(PictureSet set,
                                                                const PictureSceneOptions& options);

/// What is known of the depths of pictures.
struct DepthSheet {
  /// A row for each picture, in up to three columns. A row is: the picture; its depth, from yellow
  /// (near) to blue, black where it is not known; how many other pictures confirm that depth, from
  /// red (none) to green; the depth of the surface that scenes use.
  Image image;
  std::string source;       ///< "z", "ray", "inverse": stated so; "estimated"; "silhouettes": none
  double known = 0;         ///< share of the pixels inside mask and sphere whose depth is known
  double confirmed_by = 0;  ///< other pictures that confirm a depth; mean over known pixels
};

/// Finds depths as make_picture_scene() does, and shows those of up to `count` pictures, evenly
/// chosen, each `cell` pixels along its longer side. Errors as make_picture_scene().
/// REQUIRES: count and cell are above 0.
[[nodiscard]] Result<DepthSheet> make_depth_sheet(PictureSet set,
                                                  const PictureSceneOptions& options,
                                                  std::uint32_t count = 24,
                                                  std::uint32_t cell = 160);

/// A picture as the scene uses it: with its mask, and depth along z where it is known.
[[nodiscard]] Result<Image> load_picture(const Picture& picture);

}  // namespace slf
