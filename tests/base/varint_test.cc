#include "base/varint.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <vector>

namespace slf {
namespace {

Bytes literal(std::initializer_list<int> values) {
  Bytes all;
  for (const int value : values) all.push_back(static_cast<std::byte>(value));
  return all;
}

Bytes encoded(std::uint64_t value) {
  Bytes all;
  append_varint(all, value);
  return all;
}

void expect_refused(const Bytes& input) {
  ByteSpan from = input;
  EXPECT_FALSE(take_varint(from));
  EXPECT_EQ(from.size(), input.size()) << "a refused integer stays where it is";
}

TEST(Varint, HasSevenBitsPerByteLeastSignificantFirst) {
  EXPECT_EQ(encoded(0), literal({0}));
  EXPECT_EQ(encoded(127), literal({127}));
  EXPECT_EQ(encoded(128), literal({0x80, 1}));
  EXPECT_EQ(encoded(300), literal({0xAC, 2}));
  EXPECT_EQ(encoded(~std::uint64_t{0}),
            literal({0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 1}));
}

RC_GTEST_PROP(Varint, ReadsWhatWasAppendedAndNothingAfterIt,
              (std::uint64_t any, const std::vector<std::uint8_t>& more)) {
  const std::uint64_t value = any >> *rc::gen::inRange(0, 64);  // of all lengths
  const ByteSpan rest = as_bytes(std::span<const std::uint8_t>(more));
  Bytes all = encoded(value);
  RC_ASSERT(all.size() == varint_bytes(value));
  all.insert(all.end(), rest.begin(), rest.end());
  ByteSpan from = all;
  const auto read = take_varint(from);
  RC_ASSERT(read && *read == value);
  RC_ASSERT(std::ranges::equal(from, rest));
}

TEST(Varint, RefusesEveryTruncation) {
  const Bytes all = encoded(~std::uint64_t{0});
  for (std::size_t size = 0; size < all.size(); ++size)
    expect_refused(Bytes(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(size)));
}

TEST(Varint, RefusesMoreBytesThanNeeded) {
  expect_refused(literal({0x80, 0}));
  expect_refused(literal({0xFF, 0x80, 0}));
  expect_refused(literal({0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0}));
}

TEST(Varint, RefusesMoreThan64Bits) {
  expect_refused(literal({0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 2}));
  expect_refused(literal({0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x81, 0}));
  expect_refused(Bytes(1000, std::byte{0xFF}));
}

// Whatever it accepts is what append_varint() writes.
RC_GTEST_PROP(Varint, AcceptsOnlyItsOwnEncoding, (std::vector<std::uint8_t> input)) {
  for (std::uint8_t& byte : input)
    if (*rc::gen::inRange(0, 4) != 0) byte |= 0x80;
  const ByteSpan all = as_bytes(std::span<const std::uint8_t>(input));
  ByteSpan from = all;
  const auto read = take_varint(from);
  if (!read) return;
  RC_ASSERT(std::ranges::equal(encoded(*read), all.first(all.size() - from.size())));
}

}  // namespace
}  // namespace slf
