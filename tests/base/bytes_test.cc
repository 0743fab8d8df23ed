#include "base/bytes.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <array>

namespace slf {
namespace {

Bytes bytes(std::initializer_list<int> values) {
  Bytes all;
  for (const int value : values) all.push_back(static_cast<std::byte>(value));
  return all;
}

TEST(Bytes, TheFirstByteIsTheLeastInLittleAndTheMostSignificantInBigEndian) {
  const Bytes stored = bytes({0x01, 0x02, 0x03, 0x04, 0xF5, 0x06, 0x07, 0xF8});
  EXPECT_EQ(load_le<std::uint8_t>(stored.data()), 0x01);
  EXPECT_EQ(load_le<std::uint16_t>(stored.data()), 0x0201);
  EXPECT_EQ(load_le<std::uint32_t>(stored.data()), 0x04030201u);
  EXPECT_EQ(load_le<std::uint64_t>(stored.data()), 0xF80706F504030201u);
  EXPECT_EQ(load_be<std::uint8_t>(stored.data()), 0x01);
  EXPECT_EQ(load_be<std::uint16_t>(stored.data()), 0x0102);
  EXPECT_EQ(load_be<std::uint32_t>(stored.data()), 0x01020304u);
  EXPECT_EQ(load_be<std::uint64_t>(stored.data()), 0x01020304F50607F8u);
}

template <class T>
void expect_round_trip() {
  const T value = *rc::gen::arbitrary<T>();
  // One byte off any alignment, with a guard on both sides.
  std::array<std::byte, sizeof(T) + 2> place;
  for (const bool little : {true, false}) {
    place.fill(std::byte{0xA5});
    std::byte* const at = place.data() + 1;
    little ? store_le(at, value) : store_be(at, value);
    RC_ASSERT((little ? load_le<T>(at) : load_be<T>(at)) == value);
    RC_ASSERT(place.front() == std::byte{0xA5} && place.back() == std::byte{0xA5});
  }
}

RC_GTEST_PROP(Bytes, WhatIsStoredIsLoaded, ()) {
  expect_round_trip<std::uint8_t>();
  expect_round_trip<std::uint16_t>();
  expect_round_trip<std::uint32_t>();
  expect_round_trip<std::uint64_t>();
}

// The container's keys rely on it.
RC_GTEST_PROP(Bytes, BigEndianNumbersSortAsTheirBytes, (std::uint32_t a, std::uint32_t b)) {
  std::array<std::byte, 4> first, second;
  store_be(first.data(), a);
  store_be(second.data(), b);
  RC_ASSERT((std::memcmp(first.data(), second.data(), 4) < 0) == (a < b));
}

TEST(Bytes, AppendGrowsByTheSizeOfTheNumber) {
  Bytes all = bytes({9});
  append_le<std::uint16_t>(all, 0x0201);
  append_le<std::uint8_t>(all, 3);
  EXPECT_EQ(all, bytes({9, 1, 2, 3}));
}

}  // namespace
}  // namespace slf
