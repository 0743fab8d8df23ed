// What is kept of remote fields between commands, and fields at several addresses.
#include <sys/resource.h>

#include <csignal>
#include <filesystem>

#include "field/remote/remote_file.h"
#include "tests/remote/remote_testing.h"

namespace slf {
namespace {

/// A folder for a cache.
class RemoteCacheTest : public RemoteTest {
 protected:
  [[nodiscard]] RemoteOptions options(std::uint64_t bytes = 1 << 30) const {
    RemoteOptions options = kImpatient;
    options.cache = cache_;
    options.cache_bytes = bytes;
    return options;
  }
  [[nodiscard]] std::vector<std::filesystem::path> entries() const {
    return {std::filesystem::directory_iterator(cache_), {}};
  }
  /// Draws from a host, and returns what that sent.
  std::uint64_t sent_by(const HttpHost& host) {
    const std::uint64_t before = host.sent();
    expect_picture(draw(host, options()));
    return host.sent() - before;
  }

  testing::TemporaryFolder parent_;
  const std::string cache_ = parent_ / "cache";
};

TEST_F(RemoteCacheTest, AsksForOneByteOfWhatIsKept) {
  const HttpHost host(content_);
  EXPECT_GT(sent_by(host), 10'000u);
  const unsigned before = host.requests();
  EXPECT_LT(sent_by(host), 1000u);
  EXPECT_EQ(host.requests(), before + 1);
  const auto folder = std::filesystem::status(cache_).permissions();
  EXPECT_EQ(folder, std::filesystem::perms::owner_all);
  // Not another address, and not for another command without the option.
  expect_picture(draw(host));
  EXPECT_GT(host.requests(), before + 2);
}

TEST_F(RemoteCacheTest, ServesNothingOfAFileThatChanged) {
  std::string headers = "ETag: \"1\"\r\n";
  HttpHost* at = nullptr;
  HttpHost host(content_,
                [&](Exchange& e) { e.headers = headers + at->content_range(e.begin, e.end); });
  at = &host;
  const std::uint64_t all = sent_by(host);
  headers = "ETag: \"2\"\r\n";
  EXPECT_GT(sent_by(host), all / 2);
  EXPECT_LT(sent_by(host), 1000u);
  // A date: the ends are fetched each time. Without any, and if the server forbids it: nothing is
  // kept.
  headers = "Last-Modified: Tue, 01 Jan 2030 00:00:00 GMT\r\n";
  EXPECT_GT(sent_by(host), all / 2);
  EXPECT_LT(sent_by(host), all / 2);
  for (const char* const none : {"", "ETag: \"3\"\r\nCache-Control: no-store\r\n"}) {
    headers = none;
    const std::size_t count = entries().size();
    EXPECT_GT(sent_by(host), all / 2);
    EXPECT_GT(sent_by(host), all / 2);
    EXPECT_EQ(entries().size(), count);
  }
}

TEST_F(RemoteCacheTest, FetchesDamagedEntriesAgain) {
  const HttpHost host(content_);
  const std::uint64_t all = sent_by(host);
  std::size_t number = 0;
  for (const auto& entry : entries()) {
    const auto bytes = static_cast<std::streamoff>(std::filesystem::file_size(entry));
    std::fstream file(entry, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(number % 2 == 0 ? 3 : bytes - 1);  // its checksum; its last byte
    file.put('\x5a');
    file.close();
    if (++number % 3 == 0) std::filesystem::resize_file(entry, 5);
  }
  EXPECT_GT(sent_by(host), all / 2);
  EXPECT_LT(sent_by(host), 1000u);
}

TEST_F(RemoteCacheTest, IsBounded) {
  const HttpHost host(content_);
  const std::uint64_t all = sent_by(host), limit = all / 2;
  std::ofstream(parent_ / "mine") << "not ours";
  const std::filesystem::path mine = cache_ + "/slf-range-notes";
  std::ofstream(mine) << "not ours";
  const auto before = std::filesystem::file_time_type::clock::now() - std::chrono::hours(1);
  std::filesystem::last_write_time(mine, before);  // the least recently used
  for (int k = 0; k < 3; ++k) {
    expect_picture(draw(host, options(limit)));
    std::uint64_t bytes = 0;
    for (const auto& entry : entries()) bytes += std::filesystem::file_size(entry);
    EXPECT_LE(bytes, limit + 8);
  }
  EXPECT_TRUE(std::filesystem::exists(mine));
}

TEST_F(RemoteCacheTest, SeveralProcessesShareIt) {
  const HttpHost host(content_);
  for (const std::uint64_t limit : {std::uint64_t{1} << 30, content_.size() / 4}) {
    std::vector<std::thread> others;
    for (int k = 0; k < 4; ++k)
      others.emplace_back([&] { expect_picture(draw(host, options(limit))); });
    for (std::thread& other : others) other.join();
  }
}

TEST_F(RemoteCacheTest, GoesOnWithoutRoom) {
  const HttpHost host(content_);
  std::filesystem::create_directory(cache_);
  std::filesystem::permissions(cache_, std::filesystem::perms::owner_all);
  rlimit before = {};
  ::getrlimit(RLIMIT_FSIZE, &before);
  const auto handler = ::signal(SIGXFSZ, SIG_IGN);
  const auto source = RemoteFile::open(host.url(), options(), {});
  ASSERT_TRUE(source) << source.error().message;
  rlimit none = before;
  none.rlim_cur = 1000;
  ::setrlimit(RLIMIT_FSIZE, &none);
  std::string got;
  const storage::FileRange range[] = {{0, 20'000}};
  const auto fetched = (*source)->fetch(range, [&](std::uint64_t, ByteSpan bytes) {
    got.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    return Result<void>();
  });
  ::setrlimit(RLIMIT_FSIZE, &before);
  ::signal(SIGXFSZ, handler);
  EXPECT_TRUE(fetched);
  EXPECT_EQ(got, content_.substr(0, 20'000));
  EXPECT_TRUE(entries().empty());
}

TEST_F(RemoteCacheTest, RefusesAFolderThatOthersMayWriteTo) {
  const HttpHost host(content_);
  std::filesystem::create_directory(cache_);
  std::filesystem::permissions(cache_, std::filesystem::perms::all);
  const auto image = draw(host, options());
  ASSERT_FALSE(image);
  EXPECT_EQ(image.error().code, ErrorCode::usage);
  EXPECT_THAT(image.error().message, HasSubstr(cache_));
}

// Mirrors: the picture comes whatever one host does.
TEST_F(RemoteTest, AsksMirrorsForWhatAHostFailsToSend) {
  for (const char* const status :
       {"429 Too Many Requests", "503 Service Unavailable", "404 Not Found", ""})
    for (const unsigned from : {0u, 1u, 4u, 5u}) {
      const HttpHost bad(content_, [&](Exchange& e) {
        if (e.number < from) return;
        e.hangs_up = *status == 0;
        if (!e.hangs_up) e.status = status;
      });
      const HttpHost good(content_);
      const auto begin = std::chrono::steady_clock::now();
      const auto remote = RemoteField::open(bad.url() + " " + good.url(), kImpatient);
      ASSERT_TRUE(remote) << remote.error().message;
      Renderer renderer(remote->field(), {.threads = 2});
      expect_picture(renderer.render(camera(), {RenderMode::depth, 1}));
      EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(5));
      EXPECT_GT(good.requests(), 0u);
      EXPECT_LE(bad.requests(), from + 8);  // once, as many as are under way
      // A host reads later what was under way when another one failed; one that hangs up may not.
      const unsigned unseen = *status == 0 ? 8 : 0;
      const auto seen = [&] { return bad.requests() + good.requests() + unseen; };
      for (int k = 0; k < 200 && remote->traffic().requests > seen(); ++k)
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      EXPECT_LE(remote->traffic().requests, seen());
    }
}

TEST_F(RemoteTest, AsksAHostAgainWhenItSaysAndAllOthersFail) {
  unsigned refusals = 0;
  auto first = std::chrono::steady_clock::time_point(), second = first;
  const HttpHost busy(content_, [&](Exchange& e) {
    if (e.number == 4) first = std::chrono::steady_clock::now();
    if (first != second && e.number > 4 && second == decltype(second)())
      second = std::chrono::steady_clock::now();
    if (e.number == 4)
      ++refusals, e.status = "429 Too Many Requests", e.headers += "Retry-After: 1\r\n";
  });
  const HttpHost absent(content_, [](Exchange& e) { e.status = "503 Service Unavailable"; });
  RemoteOptions options = kImpatient;
  options.parallel = 1;
  const auto remote = RemoteField::open(busy.url() + " " + absent.url(), options);
  ASSERT_TRUE(remote) << remote.error().message;
  Renderer renderer(remote->field(), {.threads = 2});
  expect_picture(renderer.render(camera(), {RenderMode::depth, 1}));
  EXPECT_EQ(refusals, 1u);
  EXPECT_GT(second - first, std::chrono::milliseconds(900));
}

TEST_F(RemoteTest, RefusesAMirrorOfAnotherFile) {
  std::string other = content_, longer = content_ + "0123456789abcdef";
  other[other.size() - 20] ^= 1;  // in the footer of the index
  for (const std::string& content : {other, longer}) {
    const HttpHost bad(content_, [](Exchange& e) {
      if (e.number > 5) e.status = "503 Service Unavailable";
    });
    const HttpHost wrong(content);
    const HttpHost right(content_);
    const auto image = [&](const std::string& place) -> Result<Image> {
      const auto remote = RemoteField::open(place, kImpatient);
      if (!remote) return tl::unexpected(remote.error());
      return Renderer(remote->field(), {.threads = 2}).render(camera(), {RenderMode::depth, 1});
    };
    const auto none = image(bad.url() + " " + wrong.url());
    ASSERT_FALSE(none);
    EXPECT_THAT(none.error().message, HasSubstr(wrong.url() + ": not used: its file differs"));
    const HttpHost failing(content_, [](Exchange& e) {
      if (e.number > 5) e.status = "503 Service Unavailable";
    });
    expect_picture(image(failing.url() + " " + wrong.url() + " " + right.url()));
  }
}

}  // namespace
}  // namespace slf
