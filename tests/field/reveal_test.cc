#include "slf/reveal.h"

#include <gtest/gtest.h>

#include <limits>

namespace slf {
namespace {

Reveal small() {
  Reveal reveal;
  reveal.dims = {5, 4, 3};
  reveal.origin = {1, -2, 3};
  reveal.axes = glm::dmat3(2);
  reveal.low = -100, reveal.high = 155;
  reveal.greys = {-50, 100};
  reveal.gradient = 3, reveal.unit = 0.5;
  reveal.content = "xxh3-64:0123456789abcdef  ";
  for (int k = 0; k < 60; ++k) reveal.voxels.push_back(static_cast<std::byte>(4 * k));
  return reveal;
}

Reveal with_parts() {
  Reveal reveal = small();
  reveal.part_ids = {7, 9};
  reveal.masked = true;
  for (int k = 0; k < 60; ++k) reveal.parts.push_back(static_cast<std::byte>(k % 4));
  return reveal;
}

Reveal labels() {
  Reveal reveal = small();
  reveal.ids = {0, 12, 65000};
  for (std::byte& voxel : reveal.voxels)
    voxel = static_cast<std::byte>(std::to_integer<int>(voxel) % 3);
  return reveal;
}

TEST(Reveal, DecodesWhatWasEncoded) {
  for (const Reveal& reveal : {small(), with_parts(), labels()}) {
    const auto code = encode(reveal);
    ASSERT_TRUE(code) << code.error().message;
    const auto back = decode_reveal(*code);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(back->dims, reveal.dims);
    EXPECT_EQ(back->origin, reveal.origin);
    EXPECT_EQ(back->axes, reveal.axes);
    EXPECT_EQ(back->low, reveal.low);
    EXPECT_EQ(back->high, reveal.high);
    EXPECT_EQ(back->greys, reveal.greys);
    EXPECT_EQ(back->gradient, reveal.gradient);
    EXPECT_EQ(back->unit, reveal.unit);
    EXPECT_EQ(back->ids, reveal.ids);
    EXPECT_EQ(back->voxels, reveal.voxels);
    EXPECT_EQ(back->parts, reveal.parts);
    EXPECT_EQ(back->part_ids, reveal.part_ids);
    EXPECT_EQ(back->masked, reveal.masked);
    EXPECT_EQ(back->content, reveal.content);
    const auto head = decode_reveal(*code, RevealPart::head);
    ASSERT_TRUE(head);
    EXPECT_EQ(head->dims, reveal.dims);
    EXPECT_TRUE(head->voxels.empty());
  }
}

TEST(Reveal, DamageIsFound) {
  const auto code = *encode(with_parts());
  for (std::size_t size = 0; size < code.size(); ++size) {
    const auto cut = decode_reveal(std::span(code).first(size));
    ASSERT_FALSE(cut) << size;
    EXPECT_EQ(cut.error().code, ErrorCode::bad_file);
  }
  auto later = code;
  later[3] = std::byte{'2'};
  const auto refused = decode_reveal(later);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::unsupported);
}

TEST(Reveal, MembersThatContradictAreRefused) {
  const auto refused = [](auto change) {
    Reveal reveal = with_parts();
    change(reveal);
    return !encode(reveal);
  };
  EXPECT_TRUE(refused([](Reveal& r) { r.dims[0] = 1; }));
  EXPECT_TRUE(refused([](Reveal& r) { r.dims = {513, 513, 513}; }));
  EXPECT_TRUE(refused([](Reveal& r) { r.axes = glm::dmat3(0); }));
  EXPECT_TRUE(refused([](Reveal& r) { r.high = r.low; }));
  EXPECT_TRUE(refused([](Reveal& r) { r.greys[1] = std::numeric_limits<double>::infinity(); }));
  EXPECT_TRUE(refused([](Reveal& r) { r.voxels.pop_back(); }));
  EXPECT_TRUE(refused([](Reveal& r) { r.parts[3] = std::byte{4}; }));
  EXPECT_TRUE(refused([](Reveal& r) { r.ids = {1, 2}; }));  // voxels beyond them
}

TEST(Reveal, ContentTellsVolumesApart) {
  EXPECT_EQ(content_of("no json"), "");
  EXPECT_EQ(content_of(R"({"kind": "mesh", "content": "a"})"), "");
  EXPECT_EQ(content_of(R"({"kind": "volume", "content": "a"})"), "a  ");
  EXPECT_EQ(content_of(R"({"kind": "volume", "content": "a", "clip": [[0,0,0,1,0,0]]})"), "a  ");
  EXPECT_NE(content_of(R"({"kind": "volume", "content": "a", "structures": {"mask": "m"}})"),
            content_of(R"({"kind": "volume", "content": "a", "structures": {"labels": "m"}})"));
}

}  // namespace
}  // namespace slf
