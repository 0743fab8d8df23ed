// Reading a mesh in a child process, whatever the child does.
#include "field/mesh/isolated.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <new>
#include <stdexcept>

#include "base/try.h"
#include "tests/temporary_folder.h"

namespace slf {
namespace {

using ::testing::HasSubstr;

Mesh some_mesh() {
  Mesh mesh;
  mesh.source = "a.ply";
  for (int k = 0; k < 100000; ++k) mesh.positions.emplace_back(k, k % 7, k % 11);
  mesh.normals.assign(mesh.positions.size(), glm::vec3(0, 0, 1));
  mesh.colors.assign(mesh.positions.size(), glm::u8vec4(1, 2, 3, 4));
  for (unsigned k = 0; k + 2 < 100000; ++k) mesh.triangles.emplace_back(k, k + 1, k + 2);
  mesh.material_of.assign(mesh.triangles.size(), 1);
  mesh.materials.resize(2);
  mesh.materials[1] = {.name = "glass",
                       .color = {0.1f, 0.2f, 0.3f, 0.4f},
                       .texture = 0,
                       .repeat_u = true,
                       .repeat_v = false,
                       .opacity = MeshOpacity::blend,
                       .cutoff = 0.25f};
  mesh.textures.push_back({"t.png", 2, 1, {glm::u8vec4(5), glm::u8vec4(6)}});
  mesh.files = {"a.ply", "t.png"};
  mesh.notes = {"a note", ""};
  return mesh;
}

Result<Mesh> isolated(const std::function<Result<Mesh>()>& read, std::uint64_t seconds = 60) {
  return read_isolated("a.ply", std::uint64_t{1} << 30, seconds, read);
}

Error error_of(const std::function<Result<Mesh>()>& read, std::uint64_t seconds = 60) {
  const auto mesh = isolated(read, seconds);
  return mesh ? Error{ErrorCode::failed, "no error", {}} : mesh.error();
}

TEST(IsolatedMesh, ArrivesAsItIs) {
  const Mesh expected = some_mesh();
  const auto mesh = isolated([] { return Result<Mesh>(some_mesh()); });
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_EQ(content_hash(*mesh), content_hash(expected));
  EXPECT_EQ(mesh->source, expected.source);
  EXPECT_EQ(mesh->files, expected.files);
  EXPECT_EQ(mesh->notes, expected.notes);
  EXPECT_EQ(mesh->materials[1].name, "glass");
  EXPECT_TRUE(mesh->materials[1].repeat_u);
  EXPECT_FALSE(mesh->materials[1].repeat_v);
  EXPECT_EQ(mesh->textures[0].name, "t.png");
}

TEST(IsolatedMesh, ErrorsAndExceptionsComeBack) {
  const Error error =
      error_of([]() -> Result<Mesh> { return fail(ErrorCode::unsupported, "a.ply: no"); });
  EXPECT_EQ(error.code, ErrorCode::unsupported);
  EXPECT_EQ(error.message, "a.ply: no");
  EXPECT_EQ(error_of([]() -> Result<Mesh> { throw std::bad_alloc(); }).code,
            ErrorCode::out_of_memory);
  EXPECT_THAT(error_of([]() -> Result<Mesh> { throw std::runtime_error("odd"); }).message,
              HasSubstr("odd"));
}

TEST(IsolatedMesh, CrashesAreErrors) {
  const Error aborted = error_of([]() -> Result<Mesh> { std::abort(); });
  EXPECT_EQ(aborted.code, ErrorCode::bad_file);
  EXPECT_THAT(aborted.message, HasSubstr("a.ply: crashes its reader (Aborted)"));
  EXPECT_THAT(error_of([]() -> Result<Mesh> {
                ::raise(SIGSEGV);
                return Mesh();
              }).message,
              HasSubstr("crashes its reader (Segmentation fault)"));
  EXPECT_THAT(error_of([]() -> Result<Mesh> { ::_exit(3); }).message, HasSubstr("status 3"));
  EXPECT_EQ(error_of([]() -> Result<Mesh> {
              ::raise(SIGKILL);
              return Mesh();
            }).code,
            ErrorCode::failed);
}

TEST(IsolatedMesh, TimeIsLimited) {
  const Error late = error_of(
      []() -> Result<Mesh> {
        while (::getppid() > 0) {
        }
        return Mesh();
      },
      1);
  EXPECT_EQ(late.code, ErrorCode::bad_file);
  EXPECT_THAT(late.message, HasSubstr("not read within 1 s"));
}

TEST(IsolatedMesh, WhatContradictsItselfIsRefused) {
  const auto refused = [](const std::function<void(Mesh&)>& change) {
    return error_of([&] {
             Mesh mesh = some_mesh();
             change(mesh);
             return Result<Mesh>(std::move(mesh));
           })
        .message;
  };
  const auto kWhat = HasSubstr("contradicts itself");
  EXPECT_EQ(refused([](Mesh&) {}), "no error");
  EXPECT_THAT(refused([](Mesh& m) { m.triangles[5].y = 100000; }), kWhat);
  EXPECT_THAT(refused([](Mesh& m) { m.normals.pop_back(); }), kWhat);
  EXPECT_THAT(refused([](Mesh& m) { m.material_of[3] = 2; }), kWhat);
  EXPECT_THAT(refused([](Mesh& m) { m.material_of.pop_back(); }), kWhat);
  EXPECT_THAT(refused([](Mesh& m) { m.materials[0].texture = 1; }), kWhat);
  EXPECT_THAT(refused([](Mesh& m) { m.textures[0].width = 3; }), kWhat);
  EXPECT_THAT(refused([](Mesh& m) { m.positions[9].z = std::numeric_limits<float>::infinity(); }),
              kWhat);
}

TEST(IsolatedMesh, AFileThatMakesAssimpAbortIsAnError) {
  const testing::TemporaryFolder folder;
  // A polygon without corners.
  std::ofstream(folder / "a.ply")
      << "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      << "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
      << "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n0 1 1 1\n";
  const auto mesh = read_mesh(folder / "a.ply");
  ASSERT_FALSE(mesh);
  EXPECT_EQ(mesh.error().code, ErrorCode::bad_file);
}

TEST(IsolatedMesh, AHeaderThatDoesNotEndIsAnErrorInAnyCase) {
  const testing::TemporaryFolder folder;
  std::ofstream(folder / "a.ply") << "pLy\nformat ascii 1.0\nelement vertex 3\np";
  const auto mesh = read_mesh(folder / "a.ply");
  ASSERT_FALSE(mesh);
  EXPECT_THAT(mesh.error().message, HasSubstr("its header does not end"));
}

}  // namespace
}  // namespace slf
