// Cinema databases as ParaView writes them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "slf/build.h"
#include "source/pictures/cameras.h"
#include "tests/source/pictures/samples.h"

namespace slf {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class Cinema : public PictureScenes {
 protected:
  Result<PictureSet> read(const std::string& csv) const {
    write_picture("a.png", 40, 30);
    write_picture("b.png", 40, 30);
    write_picture("c.png", 40, 30);
    write("data.csv", csv);
    return read_pictures(path("."));
  }
  std::string message(const std::string& csv) const {
    const auto set = read(csv);
    return set ? "no error" : set.error().message;
  }
};

TEST_F(Cinema, AnglesAreThoseOfParaView) {
  const auto set = read("phi,theta,FILE\r\n0,0,a.png\r\n90,0,b.png\r\n000.00,30.5,\"c.png\"\r\n");
  ASSERT_TRUE(set) << set.error().message;
  ASSERT_EQ(set->pictures.size(), 3u);
  // The sphere of radius 1 fits the height, at 30 degrees.
  const double distance = 1 / std::sin(std::numbers::pi / 12);
  const Picture& front = set->pictures[0];
  EXPECT_EQ(front.file, path("a.png"));
  EXPECT_NEAR(glm::distance(front.eye, {0, -distance, 0}), 0, 1e-9);
  EXPECT_NEAR(glm::distance(front.axes[2], {0, 1, 0}), 0, 1e-9);  // forward
  EXPECT_NEAR(glm::distance(front.axes[0], {1, 0, 0}), 0, 1e-9);  // right
  EXPECT_NEAR(glm::distance(front.axes[1], {0, 0, -1}), 0, 1e-9);
  EXPECT_NEAR(front.lens.fx, 15 / std::tan(std::numbers::pi / 12), 1e-9);
  EXPECT_NEAR(glm::distance(set->pictures[1].eye, {distance, 0, 0}), 0, 1e-9);
  const double angle = 30.5 * std::numbers::pi / 180;
  EXPECT_NEAR(glm::distance(set->pictures[2].eye,
                            distance * glm::dvec3(0, -std::cos(angle), std::sin(angle))),
              0, 1e-9);
  for (const Picture& picture : set->pictures)
    EXPECT_NEAR(glm::determinant(picture.axes), 1, 1e-12);
  EXPECT_THAT(set->notes, ElementsAre(HasSubstr("view angle to be 30 degrees")));
}

TEST_F(Cinema, AByteOrderMarkIsNoPartOfTheFirstColumn) {
  const auto set = read("\xef\xbb\xbfphi,theta,FILE\n0,0,a.png\n90,0,b.png\n0,30,c.png\n");
  ASSERT_TRUE(set) << set.error().message;
  EXPECT_EQ(set->pictures.size(), 3u);
}

TEST_F(Cinema, OnePictureOfEachDirectionIsRead) {
  write("a_z.tif", std::string("depths"));
  const auto set = read(
      "time,PHI,Theta,view_angle,FILE,FILE_depth\n"
      "0.5,0,0,45,a.png,a_z.tif\n"
      "1.5,0,0,45,c.png,c_z.tif\n"
      "0.5,90,0,45,b.png,\n");
  ASSERT_TRUE(set) << set.error().message;
  ASSERT_EQ(set->pictures.size(), 2u);
  EXPECT_EQ(set->pictures[0].depth, path("a_z.tif"));
  EXPECT_THAT(set->pictures[1].depth, IsEmpty());
  EXPECT_NEAR(set->pictures[0].lens.fy, 15 / std::tan(std::numbers::pi / 8), 1e-9);
  EXPECT_THAT(set->notes, Contains(HasSubstr("1 pictures with other parameters than time 0.5")));
}

TEST_F(Cinema, DamageIsNamed) {
  EXPECT_THAT(message(""), HasSubstr("columns phi, theta and FILE"));
  EXPECT_THAT(message("phi,FILE\n0,a.png\n"), HasSubstr("columns phi, theta and FILE"));
  EXPECT_THAT(message("phi,theta,FILE\n"), HasSubstr("has no pictures"));
  EXPECT_THAT(message("phi,theta,FILE\n0,0\n"), AllOf(HasSubstr("row 2"), HasSubstr("2 cells")));
  EXPECT_THAT(message("phi,theta,FILE\n0,0,a.png\n0,up,b.png\n"),
              AllOf(HasSubstr("row 3"), HasSubstr("no number of degrees")));
  EXPECT_THAT(message("phi,theta,FILE\n0,nan,a.png\n"), HasSubstr("no number of degrees"));
  EXPECT_THAT(message("phi,theta,view_angle,FILE\n0,0,180,a.png\n"), HasSubstr("no number"));
  EXPECT_THAT(message("phi,theta,FILE\n0,0,none.png\n"), HasSubstr("none.png"));
  EXPECT_THAT(message("phi,theta,FILE\n0,0,\"a.png\n"), HasSubstr("a.png\n"));
}

/// The balls as a database, whose angles a row each of 15 degrees apart.
TEST_F(Cinema, MakesAScene) {
  std::string csv = "phi,theta,FILE,FILE_depth\n";
  // The world of the database has the sphere of the balls as its unit.
  const Sphere sphere = balls_->bounds();
  for (int theta = -60; theta <= 60; theta += 30)
    for (int phi = 0; phi < 360; phi += 30) {
      const std::string name = std::to_string(phi) + "_" + std::to_string(theta);
      csv += std::to_string(phi) + "," + std::to_string(theta) + "," + name + ".exr,\n";
    }
  // Placeholders tell the size; then each is drawn as its camera says.
  for (int theta = -60; theta <= 60; theta += 30)
    for (int phi = 0; phi < 360; phi += 30)
      write_picture(std::to_string(phi) + "_" + std::to_string(theta) + ".exr", 96, 96);
  write("balls.csv", csv);
  auto set = read_pictures(path("balls.csv"));
  ASSERT_TRUE(set) << set.error().message;
  for (const Picture& picture : set->pictures) {
    Picture placed = picture;
    placed.eye = sphere.center + sphere.radius * picture.eye;
    Image image = view(placed);
    for (float& depth : image.depth) depth /= static_cast<float>(sphere.radius);
    ASSERT_TRUE(write_image(picture.file, image));
  }
  const auto scene = make_picture_scene(*set, {.voxels = 96});
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ(Json::parse((*scene)->provenance())["depth"], "ray");
  EXPECT_LT(glm::distance((*scene)->bounds().center, glm::dvec3(0)), 0.2);
  EXPECT_LT((*scene)->bounds().radius, 1.1);
  // From another direction, in the world of the database.
  Picture other = set->pictures[7];
  const double turn = 0.2;
  const glm::dmat3 around(std::cos(turn), std::sin(turn), 0, -std::sin(turn), std::cos(turn), 0, 0,
                          0, 1);
  other.eye = around * other.eye;
  other.axes = around * other.axes;
  Picture placed = other;
  placed.eye = sphere.center + sphere.radius * other.eye;
  EXPECT_GT(compare(view(placed), view(**scene, other)).psnr, 22);
}

}  // namespace
}  // namespace slf
