// Cameras as other programs write them, and lenses.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "base/bytes.h"
#include "slf/measure.h"
#include "slf/pictures.h"
#include "source/pictures/cameras.h"
#include "tests/source/pictures/samples.h"

namespace slf {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST_F(Pictures, CamerasOfBlenderLookAlongMinusZWithYUp) {
  write("transforms.json", transforms());
  const auto set = read_pictures(path("."));
  ASSERT_TRUE(set) << set.error().message;
  ASSERT_EQ(set->pictures.size(), 1u);
  const Picture& picture = set->pictures[0];
  EXPECT_EQ(picture.file, path("a.png"));
  EXPECT_EQ(picture.eye, glm::dvec3(1, 2, 3));
  EXPECT_EQ(picture.axes[2], glm::dvec3(0, 0, -1));
  EXPECT_EQ(picture.axes[1], glm::dvec3(0, -1, 0));
  EXPECT_NEAR(picture.lens.fx, 20 / std::tan(0.4), 1e-9);
  EXPECT_EQ(picture.lens.cx, 20);
  EXPECT_EQ(picture.lens.cy, 15);
  // Above and to the right of the axis is in the upper right of the picture.
  const auto place = picture.lens.project(picture.to_camera({1.1, 2.1, 2}));
  ASSERT_TRUE(place);
  EXPECT_GT(place->x, 20);
  EXPECT_LT(place->y, 15);
}

TEST_F(Pictures, FramesMayHaveTheirOwnLenses) {
  Json json = transforms();
  json["frames"][0]["fl_x"] = 50;
  json["frames"][0]["fl_y"] = 51;
  json["frames"][0]["cx"] = 22.5;
  json["k1"] = 0.01;
  json["aabb_scale"] = 16;
  write("transforms.json", json);
  const auto set = read_pictures(path("transforms.json"));
  ASSERT_TRUE(set) << set.error().message;
  const Lens& lens = set->pictures[0].lens;
  EXPECT_EQ(lens.fx, 50);
  EXPECT_EQ(lens.fy, 51);
  EXPECT_EQ(lens.cx, 22.5);
  EXPECT_EQ(lens.k[0], 0.01);
  EXPECT_THAT(set->notes, ::testing::Contains(HasSubstr("aabb_scale")));
}

TEST_F(Pictures, BadCamerasAreNamed) {
  const Json good = transforms();
  const auto with = [&](const char* pointer, const Json& value) {
    Json json = good;
    json[Json::json_pointer(pointer)] = value;
    return message_of(json);
  };
  EXPECT_EQ(message_of(good), "no error");
  EXPECT_THAT(message_of(Json::array()), HasSubstr("expected JSON with an array \"frames\""));
  EXPECT_THAT(with("/frames", Json::array()), HasSubstr("no frames"));
  const std::string matrix = "/frames/0/transform_matrix";
  EXPECT_THAT(with((matrix + "/0").c_str(), {0, 0, 0, 1}),
              AllOf(HasSubstr("frame 0 (a)"), HasSubstr("singular")));
  EXPECT_THAT(with((matrix + "/0").c_str(), {-1, 0, 0, 1}), HasSubstr("mirrors the world"));
  EXPECT_THAT(with((matrix + "/0").c_str(), {1, 0.3, 0, 1}), HasSubstr("not rigid"));
  EXPECT_THAT(with((matrix + "/0").c_str(), {1, 0, 0}), HasSubstr("a row of not 4 numbers"));
  EXPECT_THAT(with((matrix + "/0/3").c_str(), nullptr), HasSubstr("not finite"));
  EXPECT_THAT(with("/frames/0/file_path", 3), HasSubstr("expected a member \"file_path\""));
  EXPECT_THAT(with("/camera_angle_x", "wide"), HasSubstr("no focal length"));
  EXPECT_THAT(with("/camera_angle_x", 0), HasSubstr("focal length of"));
  EXPECT_THAT(with("/camera_angle_x", 38.9), HasSubstr("in radians"));
  EXPECT_THAT(with("/camera_model", "EQUIRECTANGULAR"), HasSubstr("EQUIRECTANGULAR"));
  EXPECT_THAT(with("/w", -5), HasSubstr("no error"));  // only counts together with h
  Json missing = good;
  missing["frames"][0]["file_path"] = "b";
  missing["w"] = 40, missing["h"] = 30;
  EXPECT_THAT(message_of(missing), AllOf(HasSubstr("there is no picture"), HasSubstr("/b")));
}

// As by instant-ngp and nerfstudio: lists are often longer than the folder of pictures.
TEST_F(Pictures, WhatCannotBeUsedIsLeftOutAndCounted) {
  for (const bool sized : {false, true}) {
    SCOPED_TRACE(sized);
    Json json = transforms();
    if (sized) json["w"] = 40, json["h"] = 30;
    const Json frame = json["frames"][0];
    const auto add = [&](const std::string& file) -> Json& {
      json["frames"].push_back(frame);
      json["frames"].back()["file_path"] = file;
      return json["frames"].back();
    };
    add("a");  // once more
    write_picture("b.png", 40, 30);
    add("b");
    add("gone_1");
    add("gone_2");
    write("text.png", std::string("no picture"));
    add("text.png");
    write("transforms.json", json);
    auto set = read_pictures(path("transforms.json"));
    ASSERT_TRUE(set) << set.error().message;
    EXPECT_EQ(set->pictures.size(), 2u);
    for (const auto& [counted, named] :
         {std::pair{"2 of ", "gone_1"}, {"1 of ", "text.png"}, {"1 pictures are there twice", ""}})
      EXPECT_THAT(set->notes,
                  ::testing::Contains(AllOf(::testing::StartsWith(counted), HasSubstr(named))));
    // So are those whose mask is missing, and those of another shape.
    write_picture("c.png", 40, 30);
    write_picture("d.png", 40, 30);
    write_picture("e.png", 30, 40);
    add("c")["mask_path"] = "none.png";
    add("d")["depth_file_path"] = "none.png";
    Json& turned = add("e");
    turned["w"] = 40, turned["h"] = 30;
    ASSERT_EQ(::mkfifo(path(sized ? "pipe1.png" : "pipe.png").c_str(), 0600), 0);
    add(sized ? "pipe1.png" : "pipe.png");
    write("transforms.json", json);
    set = read_pictures(path("transforms.json"));
    ASSERT_TRUE(set) << set.error().message;
    EXPECT_EQ(set->pictures.size(), 3u);  // d without its depths
    EXPECT_THAT(set->notes, ::testing::Contains("1 pictures of depths are missing"));
    // One picture is too little.
    for (const char* file : {"b.png", "d.png"}) std::filesystem::remove(path(file));
    EXPECT_THAT(message_of(json), AllOf(HasSubstr("there is no"), HasSubstr("1 can be used")));
  }
}

// As programs on Windows name them, and cameras that changed the case.
TEST_F(Pictures, NamesMayHaveBackslashesAndAnotherCase) {
  Json json = transforms();
  const Json frame = json["frames"][0];
  json["frames"].clear();
  write_picture("Images/R_0.png", 40, 30);
  std::filesystem::rename(path("Images/R_0.png"), path("Images/R_0.JPG"));  // not told by its name
  write_picture("Images/r_1.png", 40, 30);
  write_picture("Images/back\\slash.png", 40, 30);
  write_picture("Images/masks/m.png", 40, 30);
  for (const char* name : {".\\images\\r_0.jpg", "images/R_1", "Images/back\\slash.png"}) {
    json["frames"].push_back(frame);
    json["frames"].back()["file_path"] = name;
    json["frames"].back()["mask_path"] = "images\\Masks\\M.PNG";
  }
  write("transforms.json", json);
  const auto set = read_pictures(path("."));
  ASSERT_TRUE(set) << set.error().message;
  std::vector<std::string> files;
  for (const Picture& picture : set->pictures) {
    files.push_back(picture.file);
    EXPECT_EQ(picture.mask, path("Images/masks/m.png"));
  }
  EXPECT_THAT(files, ::testing::UnorderedElementsAre(path("Images/R_0.JPG"), path("Images/r_1.png"),
                                                     path("Images/back\\slash.png")));
}

// A set that was moved to another place.
TEST_F(Pictures, AreFoundByTheirLastFolders) {
  for (const char* before : {"/home/user/data/", "C:\\Users\\me\\data\\", "data/", "../x/"}) {
    Json json = transforms();
    const Json frame = json["frames"][0];
    json["frames"].clear();
    for (const char* name : {"0.png", "1.png"}) {
      write_picture(std::string("images/") + name, 40, 30);
      write_picture(std::string("other/") + name, 40, 30);
      json["frames"].push_back(frame);
      json["frames"].back()["file_path"] = std::string(before) + "images/" + name;
    }
    write("transforms.json", json);
    const auto set = read_pictures(path("."));
    ASSERT_TRUE(set) << set.error().message;
    EXPECT_EQ(set->pictures.at(0).file, path("images/0.png"));
    EXPECT_EQ(set->pictures.at(1).file, path("images/1.png"));
    EXPECT_THAT(set->notes, ::testing::Contains(HasSubstr("2 files are not at the paths")));
  }
}

TEST_F(Pictures, CamerasOfOtherProgramsAreNamed) {
  for (const auto& [file, text, program] : std::vector<std::array<std::string, 3>>{
           {"sfm_data.json", "{\"sfm_data_version\": \"0.3\", \"views\": []}", "OpenMVG"},
           {"cameras.json", "{\"version\": [\"1\"], \"featuresFolders\": []}", "Meshroom"},
           {"cameras.xml", "<?xml version=\"1.0\"?>\n<document version=\"1.5.0\">", "Metashape"},
           {"bundle.out", "# Bundle file v0.3\n2 0\n", "Bundler"},
           {"cameras.csv", "#name,x,y,alt,heading,pitch,roll\n", "RealityCapture"}}) {
    write(file, text);
    const auto set = read_pictures(path(file));
    ASSERT_FALSE(set);
    EXPECT_EQ(set.error().code, ErrorCode::unsupported) << file;
    EXPECT_THAT(set.error().message, AllOf(HasSubstr(program), HasSubstr("COLMAP")));
  }
}

TEST_F(Pictures, AnglesMayBeThoseOfInstantNgp) {
  Json json = transforms();
  json["frames"].push_back(json["frames"][0]);
  write_picture("b.png", 40, 30);
  json["frames"].back()["file_path"] = "b.png";
  json["camera_angle_x"] = 90 * std::numbers::pi / 180;
  write("a.json", json);
  json.erase("camera_angle_x");
  json["x_fov"] = 90;
  write("b.json", json);
  const auto a = read_pictures(path("a.json")), b = read_pictures(path("b.json"));
  ASSERT_TRUE(a && b) << b.error().message;
  EXPECT_DOUBLE_EQ(a->pictures.at(0).lens.fx, 20);
  EXPECT_DOUBLE_EQ(b->pictures.at(0).lens.fx, 20);
}

TEST_F(Pictures, TransformsMayHaveComments) {
  write("a.json", "// of a drone\n" + transforms().dump() + "\n/* end */\n");
  const auto set = read_pictures(path("a.json"));
  ASSERT_TRUE(set) << set.error().message;
  EXPECT_FALSE(set->pictures.empty());
}

TEST_F(Pictures, PicturesOfAnotherSizeScaleTheirCameras) {
  Json json = transforms();
  json["w"] = 80, json["h"] = 60, json["fl_x"] = 100, json["cx"] = 41;
  write("transforms.json", json);
  const auto set = read_pictures(path("transforms.json"));
  ASSERT_TRUE(set) << set.error().message;
  EXPECT_EQ(set->pictures[0].lens.width, 40u);
  EXPECT_EQ(set->pictures[0].lens.fx, 50);
  EXPECT_EQ(set->pictures[0].lens.cx, 20.5);
  EXPECT_THAT(set->notes, ::testing::Contains(HasSubstr("80x60 to 40x30")));

  json["w"] = 30, json["h"] = 40;
  EXPECT_THAT(message_of(json), AllOf(HasSubstr("a.png"), HasSubstr("transposed")));
  json["h"] = 30;
  EXPECT_THAT(message_of(json), HasSubstr("another shape"));
}

TEST(Lens, DirectionIsTheInverseOfProject) {
  for (const bool fisheye : {false, true})
    for (const double strength : {0.0, 0.1, 1.0}) {
      Lens lens;
      lens.fisheye = fisheye;
      lens.width = 200, lens.height = 100;
      lens.fx = 150, lens.fy = 140;
      lens.cx = 90, lens.cy = 55;
      lens.k = {-0.2 * strength, 0.03 * strength, 0, 0};
      lens.p = {0.002 * strength, -0.001 * strength};
      lens.finish();
      for (const glm::dvec2 pixel : {glm::dvec2(0.5, 0.5), {199, 99}, {90, 55}, {20, 80}}) {
        const auto back = lens.project(3.0 * lens.direction(pixel));
        ASSERT_TRUE(back) << fisheye << ' ' << strength << ' ' << pixel.x;
        EXPECT_NEAR(back->x, pixel.x, 1e-6);
        EXPECT_NEAR(back->y, pixel.y, 1e-6);
      }
      EXPECT_FALSE(lens.project({0.1, 0.1, -1}));
    }
}

TEST(Lens, DistortsAsOpenCvDoes) {
  Lens lens;
  lens.width = lens.height = 1000;
  lens.fx = lens.fy = 500;
  lens.cx = lens.cy = 500;
  lens.k = {0.1, 0.01, 0, 0};
  lens.p = {0.001, 0.002};
  lens.finish();
  // cv2.projectPoints of (0.4, -0.2, 1): r² = 0.2, factor = 1.0204.
  const auto place = lens.project({0.4, -0.2, 1});
  ASSERT_TRUE(place);
  EXPECT_NEAR(place->x, 500 + 500 * (0.4 * 1.0204 + 2 * 0.001 * -0.08 + 0.002 * 0.52), 1e-9);
  EXPECT_NEAR(place->y, 500 + 500 * (-0.2 * 1.0204 + 0.001 * 0.28 + 2 * 0.002 * -0.08), 1e-9);
}

/// A COLMAP model of one camera and two images, as text.
cameras::ColmapModel text_model() {
  const auto bytes = [](const std::string& text) {
    const auto span = as_bytes(std::span(text));
    return Bytes(span.begin(), span.end());
  };
  return {"m", true, bytes("# cameras\n7 OPENCV 40 30 50 51 20 15 0.01 0.02 0.001 0.002\n"),
          bytes("# images\n1 1 0 0 0 0 0 4 7 with space.png\n1 2 3 4 5 6\n"
                "2 0.7071067811865476 0 0.7071067811865476 0 0 0 4 7 b.png\n\n"),
          bytes("1 0.5 0.25 0 255 0 0 0.1 1 1\n")};
}

cameras::ColmapModel binary_model() {
  cameras::ColmapModel model{"m", false, {}, {}, {}};
  const auto real = [](Bytes& to, double value) {
    append_le(to, std::bit_cast<std::uint64_t>(value));
  };
  append_le<std::uint64_t>(model.cameras, 1);
  append_le<std::uint32_t>(model.cameras, 7);
  append_le<std::uint32_t>(model.cameras, 4);
  append_le<std::uint64_t>(model.cameras, 40);
  append_le<std::uint64_t>(model.cameras, 30);
  for (const double p : {50., 51., 20., 15., 0.01, 0.02, 0.001, 0.002}) real(model.cameras, p);
  append_le<std::uint64_t>(model.images, 2);
  const double half = std::sqrt(0.5);
  for (const auto& [id, name, turn] :
       {std::tuple{1u, std::string("with space.png"), 0.0}, {2u, std::string("b.png"), half}}) {
    append_le<std::uint32_t>(model.images, id);
    for (const double v : {turn > 0 ? half : 1.0, 0.0, turn, 0.0, 0.0, 0.0, 4.0})
      real(model.images, v);
    append_le<std::uint32_t>(model.images, 7);
    for (const char c : name) model.images.push_back(static_cast<std::byte>(c));
    model.images.push_back(std::byte{0});
    append_le<std::uint64_t>(model.images, 2 - id);
    if (id == 1) model.images.resize(model.images.size() + 24);
  }
  append_le<std::uint64_t>(model.points, 1);
  append_le<std::uint64_t>(model.points, 1);
  for (const double v : {0.5, 0.25, 0.0}) real(model.points, v);
  model.points.resize(model.points.size() + 11);
  append_le<std::uint64_t>(model.points, 0);
  return model;
}

TEST(Colmap, TextAndBinaryModelsAreEqual) {
  for (const auto& model : {text_model(), binary_model()}) {
    const auto set = cameras::parse_colmap(model, "images");
    ASSERT_TRUE(set) << set.error().message;
    ASSERT_EQ(set->pictures.size(), 2u);
    const Picture& first = set->pictures[0];
    EXPECT_EQ(first.file, "images/with space.png");
    EXPECT_EQ(first.lens.fy, 51);
    EXPECT_EQ(first.lens.k[1], 0.02);
    EXPECT_EQ(first.lens.p[1], 0.002);
    // World to camera: the eye is behind the origin, looking along +z.
    EXPECT_EQ(first.eye, glm::dvec3(0, 0, -4));
    EXPECT_EQ(first.axes[2], glm::dvec3(0, 0, 1));
    // A quarter turn around y: the camera looks along -x, and the origin is 4 ahead.
    const Picture& second = set->pictures[1];
    EXPECT_NEAR(glm::distance(second.axes[2], {-1, 0, 0}), 0, 1e-12);
    EXPECT_NEAR(glm::distance(second.to_camera({0, 0, 0}), {0, 0, 4}), 0, 1e-12);
    ASSERT_EQ(set->points.size(), 1u);
    EXPECT_EQ(set->points[0], glm::dvec3(0.5, 0.25, 0));
  }
}

// Programs that write no points leave out the second line of each image.
TEST(Colmap, ImagesMayHaveOneLineEach) {
  const auto model_of = [](const std::string& images) {
    auto model = text_model();
    model.images.clear();
    for (const char c : images) model.images.push_back(static_cast<std::byte>(c));
    return model;
  };
  const auto names = [&](const std::string& images) {
    const auto set = cameras::parse_colmap(model_of(images), "");
    std::string all;
    if (set)
      for (const Picture& picture : set->pictures) all += picture.name + "|";
    return set ? all : set.error().message;
  };
  const std::string a = "1 1 0 0 0 0 0 4 7 a.png\n", b = "2 1 0 0 0 0 0 4 7 0002\n",
                    c = "3 1 0 0 0 0 0 4 7 c d.png\n";
  const std::string points = "1 2 -1 3.5 4 17 5 6 -1 7 8 9\n";
  EXPECT_EQ(names(a + b + c), "a.png|0002|c d.png|");
  EXPECT_EQ(names(a + "\n" + b + points + c), "a.png|0002|c d.png|");
  EXPECT_EQ(names(a + points + b + c + points), "a.png|0002|c d.png|");
  EXPECT_EQ(names("# two\n\n" + a + "# comment\n" + b), "a.png|0002|");
}

TEST_F(Pictures, FoldersThatMayNotBeEnteredDoNotMatter) {
  const auto text = [](const Bytes& bytes) {
    return std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  };
  const auto model = text_model();
  write("sparse/0/cameras.txt", text(model.cameras));
  write("sparse/0/images.txt", text(model.images));
  write("sparse/0/points3D.txt", text(model.points));
  for (const auto* name : {"with space.png", "b.png", "closed/c.png", "other/d.png"})
    write_picture(std::string("images/") + name, 40, 30);
  const auto closed = path("images/closed");
  std::filesystem::permissions(closed, std::filesystem::perms::none);
  // For root no folder is closed: be nobody for this call.
  const bool root = ::geteuid() == 0;
  ASSERT_EQ(root ? ::chmod(folder_.path().c_str(), 0755) : 0, 0);
  ASSERT_EQ(root ? ::seteuid(65534) : 0, 0);
  const auto set = read_pictures(path("."));
  ASSERT_EQ(root ? ::seteuid(0) : 0, 0);
  std::filesystem::permissions(closed, std::filesystem::perms::owner_all);
  ASSERT_TRUE(set) << set.error().message;
  EXPECT_EQ(set->pictures.size(), 2u);
  EXPECT_THAT(set->notes, ::testing::Contains(HasSubstr("1 pictures without a camera")));
}

TEST(Colmap, EveryTruncationIsAnError) {
  const auto whole = binary_model();
  for (std::size_t length = 0; length < whole.cameras.size(); ++length) {
    auto model = whole;
    model.cameras.resize(length);
    const auto set = cameras::parse_colmap(model, "");
    ASSERT_FALSE(set) << length;
    EXPECT_EQ(set.error().code, ErrorCode::bad_file);
  }
  for (std::size_t length = 0; length < whole.images.size(); ++length) {
    auto model = whole;
    model.images.resize(length);
    ASSERT_FALSE(cameras::parse_colmap(model, "")) << length;
  }
}

TEST(Colmap, UnknownModelsAndCamerasAreNamed) {
  auto model = binary_model();
  model.cameras[12] = std::byte{99};
  auto set = cameras::parse_colmap(model, "");
  ASSERT_FALSE(set);
  EXPECT_EQ(set.error().code, ErrorCode::unsupported);
  EXPECT_THAT(set.error().message, AllOf(HasSubstr("number 99"), HasSubstr("FULL_OPENCV")));
  model = binary_model();
  model.cameras[8] = std::byte{6};
  set = cameras::parse_colmap(model, "");
  ASSERT_FALSE(set);
  EXPECT_THAT(set.error().message, HasSubstr("has camera 7"));
}

TEST(Cameras, AreWellSpreadAndSurviveTheirFile) {
  const Sphere sphere{{1, 2, 3}, 2};
  const auto cameras = spread_cameras(sphere, 3, 100, 64, 48);
  ASSERT_EQ(cameras.size(), 100u);
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    EXPECT_NEAR(glm::distance(cameras[k].eye, sphere.center), 6, 1e-9);
    const auto middle = cameras[k].lens.project(cameras[k].to_camera(sphere.center));
    ASSERT_TRUE(middle);
    EXPECT_NEAR(glm::distance(*middle, {32, 24}), 0, 1e-9);
    double nearest = 1e9;
    for (std::size_t j = 0; j < cameras.size(); ++j)
      if (j != k) nearest = std::min(nearest, glm::distance(cameras[k].eye, cameras[j].eye));
    EXPECT_GT(nearest, 0.7 * 6 * std::sqrt(4 * std::numbers::pi / 100));
  }
  const auto set = cameras::parse_transforms(transforms_json(cameras, ""), "t.json", "");
  ASSERT_TRUE(set) << set.error().message;
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    EXPECT_NEAR(glm::distance(set->pictures[k].eye, cameras[k].eye), 0, 1e-12);
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(glm::distance(set->pictures[k].axes[axis], cameras[k].axes[axis]), 0, 1e-9);
    EXPECT_EQ(set->pictures[k].lens.fx, cameras[k].lens.fx);
  }
}

// A view that is cut off would be compared with a picture that is not.
TEST_F(Pictures, ThoseThatAreTooLargeWithoutDistortionAreRefused) {
  Picture picture;
  picture.name = "large.jpg";
  Lens& lens = picture.lens;
  lens.width = 9000, lens.height = 6000, lens.fx = lens.fy = 8000, lens.cx = 4500, lens.cy = 3000;
  lens.k[0] = -0.05;
  lens.finish();
  const auto camera = camera_of(picture);
  ASSERT_FALSE(camera);
  EXPECT_EQ(camera.error().code, ErrorCode::unsupported);
  EXPECT_THAT(camera.error().message, HasSubstr("large.jpg: "));
  EXPECT_THAT(camera.error().message, HasSubstr(" pixels, more than 16384 along a side; scale"));
  lens.width = 4500, lens.height = 3000, lens.fx = lens.fy = 4000, lens.cx = 2250, lens.cy = 1500;
  lens.finish();
  EXPECT_TRUE(camera_of(picture));
}

}  // namespace
}  // namespace slf
