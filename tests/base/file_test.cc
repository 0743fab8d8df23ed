// Files that get their final names: permissions, symbolic links, and what must not be lost.
#include "base/file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/temporary_folder.h"

namespace slf {
namespace {

namespace fs = std::filesystem;

class Files : public ::testing::Test {
 protected:
  [[nodiscard]] std::string at(const std::string& name) const { return folder_ / name; }
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(at(name)) << text;
  }
  [[nodiscard]] std::string text(const std::string& name) const {
    std::ifstream in(at(name));
    return {std::istreambuf_iterator<char>(in), {}};
  }
  [[nodiscard]] unsigned mode(const std::string& name) const {
    struct stat status {};
    return ::stat(at(name).c_str(), &status) == 0 ? status.st_mode & 07777 : 0;
  }
  [[nodiscard]] std::size_t count() const { return folder_.files().size(); }

  testing::TemporaryFolder folder_{fs::temp_directory_path()};
};

ByteSpan bytes(const std::string& text) { return as_bytes(std::span<const char>(text)); }

TEST_F(Files, AReplacedFileKeepsItsPermissions) {
  const std::string content = "new";
  for (const unsigned wanted : {0600u, 0640u, 0444u, 0666u}) {
    write("a", "old");
    ASSERT_EQ(::chmod(at("a").c_str(), wanted), 0);
    ASSERT_TRUE(write_file(at("a"), bytes(content)));
    EXPECT_EQ(text("a"), "new");
    EXPECT_EQ(mode("a"), wanted);
    fs::remove(at("a"));
  }
  const unsigned mask = ::umask(027);
  EXPECT_TRUE(write_file(at("b"), bytes(content)));
  ::umask(mask);
  EXPECT_EQ(mode("b"), 0640u);
  EXPECT_EQ(count(), 1u);
}

// Opening a FIFO waits for a writer, and a device may never end.
TEST_F(Files, OnlyRegularFilesAreRead) {
  ASSERT_EQ(::mkfifo(at("pipe").c_str(), 0600), 0);
  fs::create_symlink("pipe", at("link"));
  for (const std::string& path : {at("pipe"), at("link"), std::string("/dev/zero"), at("")}) {
    SCOPED_TRACE(path);
    for (const auto& error :
         {file_size(path).error(), open_regular(path).error(), read_file(path, 1 << 20).error()}) {
      EXPECT_EQ(error.code, ErrorCode::io);
      EXPECT_EQ(error.message, path + ": not a regular file");
    }
  }
  EXPECT_EQ(open_regular(at("none")).error().code, ErrorCode::not_found);
  write("a", "text");
  EXPECT_EQ(file_size(at("a")).value(), 4u);
  std::string word;
  *open_regular(at("a")) >> word;
  EXPECT_EQ(word, "text");
}

TEST_F(Files, AnOutputIsNoInputNorAnythingButAFile) {
  write("a", "old");
  fs::create_symlink("a", at("soft"));
  fs::create_hard_link(at("a"), at("hard"));
  fs::create_directory(at("folder"));
  const std::vector<std::string> inputs{"", at("none"), at("a")};
  for (const char* output : {"a", "soft", "hard", "none", "folder"})
    EXPECT_EQ(check_output(at(output), inputs).error().code, ErrorCode::usage) << output;
  EXPECT_EQ(check_output("/dev/null", {}).error().code, ErrorCode::usage);
  write("b", "old");
  EXPECT_TRUE(check_output(at("b"), inputs));
  const auto kept = check_output(at("b"), inputs, Existing::keep);
  ASSERT_FALSE(kept);
  EXPECT_STREQ(kept.error().choice, "replace");
  EXPECT_TRUE(check_output(at("c"), inputs));
}

TEST_F(Files, OnlyFilesOfOnesOwnAreRecognised) {
  EXPECT_TRUE(check_own_file(at("none"), "magic", "a cache"));
  for (const char* own : {"", "magic", "magic and more"}) {
    write("a", own);
    EXPECT_TRUE(check_own_file(at("a"), "magic", "a cache")) << own;
  }
  for (const char* foreign : {"m", "magi", "text", "Magic"}) {
    write("a", foreign);
    const auto refused = check_own_file(at("a"), "magic", "a cache");
    ASSERT_FALSE(refused) << foreign;
    EXPECT_EQ(refused.error().code, ErrorCode::usage);
    EXPECT_NE(refused.error().message.find("is not a cache"), std::string::npos);
  }
  EXPECT_FALSE(check_own_file(at(""), "magic", "a cache"));  // a folder
  write("a", "magic");
  for (const char* target : {"a", "none"}) {
    fs::create_symlink(target, at("link"));
    EXPECT_FALSE(check_own_file(at("link"), "magic", "a cache")) << target;
    fs::remove(at("link"));
  }
}

TEST_F(Files, ACopyCanBeStoppedAndLeavesNothing) {
  write("a", std::string(3 << 20, 'x'));
  ASSERT_EQ(::chmod(at("a").c_str(), 0400), 0);
  {
    auto copy = copy_file(at("a"), at("b"));
    ASSERT_TRUE(copy);
    EXPECT_EQ(count(), 1u);  // it has no name yet
    ASSERT_TRUE(copy->publish(Existing::keep));
  }
  EXPECT_EQ(text("b"), text("a"));
  EXPECT_EQ(mode("b"), 0600u);
  EXPECT_EQ(copy_file(at("a"), at("b"))->publish(Existing::keep).error().code, ErrorCode::usage);
  int calls = 0;
  const auto stopped = copy_file(at("a"), at("c"), [&](const Progress&) { return ++calls < 2; });
  EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
  EXPECT_EQ(calls, 2);
  EXPECT_EQ(count(), 2u);
}

TEST_F(Files, SymbolicLinksAreWrittenThrough) {
  const std::string content = "new";
  fs::create_directory(at("there"));
  write("there/a", "old");
  fs::create_symlink("there/a", at("relative"));
  fs::create_symlink(at("relative"), at("twice"));
  fs::create_symlink("there/new", at("dangling"));
  for (const char* link : {"relative", "twice"}) {
    write("there/a", "old");
    EXPECT_EQ(resolve_links(at(link)), at("there/a"));
    ASSERT_TRUE(write_file(at(link), bytes(content)));
    EXPECT_TRUE(fs::is_symlink(at(link)));
    EXPECT_EQ(text("there/a"), "new");
  }
  ASSERT_TRUE(write_file(at("dangling"), bytes(content)));
  EXPECT_TRUE(fs::is_symlink(at("dangling")));
  EXPECT_EQ(text("there/new"), "new");
  fs::create_symlink("loop", at("loop"));
  EXPECT_EQ(write_file(at("loop"), bytes(content)).error().code, ErrorCode::io);
}

TEST_F(Files, OneFileByAnyName) {
  write("a", "text");
  write("b", "text");
  fs::create_symlink("a", at("soft"));
  fs::create_hard_link(at("a"), at("hard"));
  EXPECT_TRUE(is_same_file(at("a"), at("./a")));
  EXPECT_TRUE(is_same_file(at("a"), at("soft")));
  EXPECT_TRUE(is_same_file(at("soft"), at("hard")));
  EXPECT_FALSE(is_same_file(at("a"), at("b")));
  EXPECT_FALSE(is_same_file(at("none"), at("none")));
}

TEST_F(Files, PublishingKeepsOrReplaces) {
  write("from", "new");
  write("to", "old");
  const auto kept = publish_file(at("from"), at("to"), Existing::keep);
  ASSERT_FALSE(kept);
  EXPECT_EQ(kept.error().code, ErrorCode::usage);
  EXPECT_EQ(text("from") + text("to"), "newold");
  ASSERT_TRUE(publish_file(at("from"), at("to"), Existing::replace));
  EXPECT_EQ(text("to"), "new");
  EXPECT_EQ(publish_file(at("from"), at("to"), Existing::replace).error().code,
            ErrorCode::not_found);
  EXPECT_EQ(text("to"), "new");
  ASSERT_TRUE(publish_file(at("to"), at("again"), Existing::keep));
  EXPECT_EQ(count(), 1u);
}

}  // namespace
}  // namespace slf
