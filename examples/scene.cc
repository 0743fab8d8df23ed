// A scene of one's own, built into a field: a sphere in the colours of its normals.
//   scene OUTPUT.slf
// slf/scene.h says what an implementation must know: threads, batches, exceptions, numbers.
#include <cstdio>

#include "slf/build.h"
#include "slf/scene.h"

class Ball final : public slf::Scene {
 public:
  slf::Sphere bounds() const override { return {glm::dvec3(0), 1}; }
  slf::RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override {
    const slf::Sphere surface{glm::dvec3(0), 0.8};
    const slf::Chord chord = slf::intersect(surface, from, to - from);
    if (!chord.hit || chord.enter < 0 || chord.enter > 1) return {};  // nothing is visible
    const glm::dvec3 normal = (from + chord.enter * (to - from)) / surface.radius;
    return {glm::vec4(0.5 + 0.5 * normal, 1), static_cast<float>(chord.enter)};
  }
  // Everything that changes the rays must be in here: an interrupted build resumes if it is equal.
  std::string provenance() const override { return R"({"kind": "ball", "version": 1})"; }
};

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: scene OUTPUT.slf\n");
    return 1;
  }
  slf::BuildOptions options;
  options.shape.sphere = Ball().bounds();
  options.shape.entry_side = 2;
  options.shape.exit_side = 8;
  const auto report = slf::build_field(Ball(), argv[1], options);
  if (!report) {
    std::fprintf(stderr, "scene: %s\n", report.error().message.c_str());
    return static_cast<int>(report.error().code);
  }
  std::printf("%llu tiles\n", static_cast<unsigned long long>(report->tiles));
  return 0;
}
