// Arrays of NumPy, alone (.npy) and in archives (.npz).
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::HasSubstr;

/// A header as NumPy writes it, and data.
std::string npy(const std::string& descr, const std::string& shape, const std::string& data,
                bool fortran = false, int version = 1) {
  std::string dictionary = "{'descr': " + descr +
                           ", 'fortran_order': " + (fortran ? "True" : "False") +
                           ", 'shape': " + shape + ", }";
  const std::size_t before = version == 1 ? 10 : 12;
  dictionary.append(63 - (before + dictionary.size()) % 64, ' ').append("\n");
  const std::string length = integer_bytes(dictionary.size(), false, false);
  return "\x93NUMPY" + std::string{static_cast<char>(version), '\0'} +
         (version == 1 ? length.substr(0, 2) : length) + dictionary + data;
}

std::string descr_of(ScalarType type, bool big_endian) {
  static const std::array<const char*, 10> kNames = {"u1", "i1", "u2", "i2", "u4",
                                                     "i4", "u8", "i8", "f4", "f8"};
  const auto* name = kNames[static_cast<std::size_t>(type)];
  return std::string("'") + (name[1] == '1' ? '|' : big_endian ? '>' : '<') + name + "'";
}

/// The phantom with z fastest, as an array in Fortran's order with the shape (3, 4, 5) is stored.
std::string phantom_fortran() {
  std::string bytes;
  for (std::uint32_t i = 0; i < kDims[0]; ++i)
    for (std::uint32_t j = 0; j < kDims[1]; ++j)
      for (std::uint32_t k = 0; k < kDims[2]; ++k)
        bytes += static_cast<char>(phantom_value(i, j, k));
  return bytes;
}

const std::string& phantom() {
  static const std::string kBytes = phantom_bytes(ScalarType::u8, false);
  return kBytes;
}

TEST(VolumeNpy, EveryTypeAndByteOrder) {
  const Folder folder;
  for (const auto type : kAllTypes)
    for (const bool big : {false, true})
      for (const int version : {1, 2, 3})
        expect_phantom(
            expect_read(folder.write("a.npy", npy(descr_of(type, big), "(3, 4, 5)",
                                                  phantom_bytes(type, big), false, version))),
            type);
}

TEST(VolumeNpy, HalfFloatsAndTruthValues) {
  const Folder folder;
  const std::string halves("\x00\x3c\x00\xc0\x00\x38\x00\x00\x01\x00\xff\x7b\x00\x00\x00\x00", 16);
  const auto half = expect_read(folder.write("a.npy", npy("'<f2'", "(2, 2, 2)", halves)));
  ASSERT_EQ(half.type, ScalarType::f32);
  EXPECT_EQ(value_at(half, 0, 0, 0), 1);
  EXPECT_EQ(value_at(half, 1, 0, 0), -2);
  EXPECT_EQ(value_at(half, 0, 1, 0), 0.5);
  EXPECT_EQ(value_at(half, 1, 0, 1), 65504);
  const auto truth = expect_read(
      folder.write("b.npy", npy("'|b1'", "(2, 2, 2)", std::string("\0\1\0\1\0\0\1\1", 8))));
  EXPECT_EQ(truth.type, ScalarType::u8);
  EXPECT_EQ(value_at(truth, 1, 0, 0), 1);
}

TEST(VolumeNpy, FortranOrderIsTheSameArray) {
  const Folder folder;
  const auto path = folder.write("a.npy", npy("'|u1'", "(3, 4, 5)", phantom_fortran(), true));
  expect_phantom(expect_read(path), ScalarType::u8);
}

TEST(VolumeNpy, SaysWhatItAssumes) {
  const Folder folder;
  const auto path = folder.write("a.npy", npy("'|u1'", "(3, 4, 5)", phantom()));
  EXPECT_THAT(
      expect_read(path).notes,
      ::testing::ElementsAre(HasSubstr("no spacing"), HasSubstr("(3, 4, 5) are taken as z, y, x")));
  const auto spaced = expect_read(path, {.spacing = glm::dvec3(1, 2, 3)});
  EXPECT_EQ(spaced.spacing(), glm::dvec3(1, 2, 3));
  EXPECT_EQ(spaced.notes.size(), 1u);
}

TEST(VolumeNpy, TimeBeforeAndColourAfter) {
  const Folder folder;
  const std::string other(phantom().size(), 'x');
  const auto times = folder.write("t.npy", npy("'|u1'", "(2, 3, 4, 5)", other + phantom()));
  expect_error(times, ErrorCode::unsupported, "choose time point 0 to 1");
  expect_phantom(expect_read(times, {.time = 1}), ScalarType::u8);
  std::string colours, time_inside;
  for (const char value : phantom()) colours += std::string("xy") + value;
  const auto rgb = folder.write("c.npy", npy("'|u1'", "(3, 4, 5, 3)", colours));
  expect_error(rgb, ErrorCode::unsupported, "choose component 0 to 2");
  expect_phantom(expect_read(rgb, {.component = 2}), ScalarType::u8);
  // The same in Fortran's order, where the first axis is the fastest.
  for (const char value : phantom_fortran()) time_inside += std::string("x") + value;
  expect_phantom(expect_read(folder.write("t.npy", npy("'|u1'", "(2, 3, 4, 5)", time_inside, true)),
                             {.time = 1}),
                 ScalarType::u8);
  expect_phantom(expect_read(folder.write("c.npy", npy("'|u1'", "(3, 4, 5, 3)",
                                                       other + other + phantom_fortran(), true)),
                             {.component = 2}),
                 ScalarType::u8);
  expect_phantom(expect_read(folder.write("1.npy", npy("'|u1'", "(1, 1, 3, 4, 5, 1)", phantom()))),
                 ScalarType::u8);
}

TEST(VolumeNpy, WhatIsNoVolumeIsNamed) {
  const Folder folder;
  const auto refuse = [&](const std::string& descr, const std::string& shape, ErrorCode code,
                          const std::string& part) {
    expect_error(folder.write("a.npy", npy(descr, shape, phantom())), code, part);
  };
  refuse("'|O'", "(3, 4, 5)", ErrorCode::unsupported, "Python objects");
  refuse("[('a', '<f4')]", "(3, 4, 5)", ErrorCode::unsupported, "records");
  refuse("'<U5'", "(3, 4, 5)", ErrorCode::unsupported, "texts");
  refuse("'<f16'", "(3, 4, 5)", ErrorCode::unsupported, "'<f16'");
  refuse("nonsense", "(3, 4, 5)", ErrorCode::bad_file, "'descr' is 'nonsense");
  refuse("'|u1'", "(60,)", ErrorCode::unsupported, "picture of 1 dimensions");
  refuse("'|u1'", "()", ErrorCode::unsupported, "picture of 0 dimensions");
  refuse("'|u1'", "(12, 5)", ErrorCode::unsupported, "picture of 2 dimensions");
  refuse("'|u1'", "(2, 3, 4, 5, 6, 7)", ErrorCode::unsupported, "shape (2, 3, 4, 5, 6, 7)");
  refuse("'|u1'", "(3, -4, 5)", ErrorCode::bad_file, "'shape' holds '-4, 5'");
  refuse("'|u1'", "(3, 4, 0)", ErrorCode::bad_file, "absurd dims");
  refuse("'|u1'", "nothing", ErrorCode::bad_file, "'shape' is 'nothing");
  refuse("'|u1'", "(3000, 3000, 3000)", ErrorCode::bad_file, "need 27000000000 bytes");
}

/// A ZIP file with these members, deflated or stored, as numpy.savez writes it: with sizes of 64
/// bits in the local header.
std::string zip(const std::vector<std::pair<std::string, std::string>>& members, bool packed) {
  const auto two = [](std::size_t value) {
    return integer_bytes(value, false, false).substr(0, 2);
  };
  const auto four = [](std::size_t value) { return integer_bytes(value, false, false); };
  std::string bytes, directory;
  for (const auto& [name, content] : members) {
    const std::string data = packed ? zlib(content).substr(2, zlib(content).size() - 6) : content;
    const std::string sums = four(crc32(0, reinterpret_cast<const Bytef*>(content.data()),
                                        static_cast<uInt>(content.size())));
    const std::string common = two(0) + two(packed ? 8 : 0) + two(0) + two(0) + sums;
    directory += "PK\1\2" + two(45) + two(45) + common + four(data.size()) + four(content.size()) +
                 two(name.size()) + two(0) + two(0) + two(0) + two(0) + four(0) +
                 four(bytes.size()) + name;
    bytes += "PK\3\4" + two(45) + common + "\xff\xff\xff\xff\xff\xff\xff\xff" + two(name.size()) +
             two(20) + name + two(1) + two(16) + integer_bytes(content.size(), true, false) +
             integer_bytes(data.size(), true, false) + data;
  }
  return bytes + directory + "PK\5\6" + two(0) + two(0) + two(members.size()) +
         two(members.size()) + four(directory.size()) + four(bytes.size()) + two(0);
}

TEST(VolumeNpy, TheOneVolumeOfAnArchive) {
  const Folder folder;
  const std::string spacing = npy("'<f8'", "(3,)", std::string(24, 'x'));
  const std::string volume = npy("'>i2'", "(3, 4, 5)", phantom_bytes(ScalarType::i16, true));
  for (const bool packed : {false, true}) {
    const auto path =
        folder.write("a.npz", zip({{"spacing.npy", spacing}, {"volume.npy", volume}}, packed));
    expect_phantom(expect_read(path), ScalarType::i16);
    expect_error(folder.write("b.npz", zip({{"a.npy", volume}, {"b.npy", volume}}, packed)),
                 ErrorCode::unsupported, "2 of its arrays ('a' (3, 4, 5), 'b' (3, 4, 5))");
    expect_phantom(expect_read(folder.path("b.npz"), {.array = "b"}), ScalarType::i16);
    expect_error(folder.path("b.npz"), ErrorCode::usage, "array 'c' was chosen, but it has 'a'",
                 {.array = "c"});
    expect_error(folder.write("c.npz", zip({{"spacing.npy", spacing}}, packed)),
                 ErrorCode::unsupported, "0 of its arrays");
  }
  expect_error(folder.write("d.zip", zip({{"a.txt", "text"}}, false)), ErrorCode::unsupported,
               "a ZIP archive");
}

TEST(VolumeNpy, MembersInAnotherFormAreNamed) {
  const Folder folder;
  const std::string whole = zip({{"a.npy", npy("'|u1'", "(3, 4, 5)", phantom())}}, false);
  const std::size_t entry = whole.find("PK\1\2");
  for (const auto& [place, value] : {std::pair{8, 1}, {10, 12}}) {  // encrypted, or by bzip2
    std::string bytes = whole;
    bytes[entry + static_cast<std::size_t>(place)] = static_cast<char>(value);
    expect_error(folder.write("a.npz", bytes), ErrorCode::unsupported,
                 "'a.npy' is encrypted, or packed by another method");
  }
  std::string bytes = whole;
  bytes[entry + 42] = 5;  // of its data
  expect_error(folder.write("a.npz", bytes), ErrorCode::bad_file, "is not where it should be");
}

TEST(VolumeNpy, TruncatedAnywhereIsAnError) {
  const Folder folder;
  const std::string array = npy("'|u1'", "(3, 4, 5)", phantom());
  for (const auto& [file, bytes] : {std::pair{"a.npy", array},
                                    {"a.npz", zip({{"a.npy", array}}, true)},
                                    {"b.npz", zip({{"a.npy", array}}, false)}})
    expect_cuts_refused(folder, file, bytes);
}

}  // namespace
}  // namespace slf
