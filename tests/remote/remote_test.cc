// Fields over HTTP: the same pictures as from the file, and servers that misbehave.
#include "slf/remote.h"

#include <gmock/gmock.h>

#include <chrono>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <memory>
#include <new>
#include <stdexcept>
#include <thread>
#include <utility>

#include "field/field_file.h"
#include "field/remote/curl_library.h"
#include "slf/repack.h"
#include "slf/verify.h"
#include "storage/tile_writer.h"
#include "tests/cli/cli_testing.h"
#include "tests/remote/remote_testing.h"

namespace slf {
namespace {

TEST_F(RemoteTest, DrawsTheSamePictures) {
  const HttpHost host(content_);
  const auto remote = RemoteField::open(host.url());
  ASSERT_TRUE(remote) << remote.error().message;
  const auto local = Field::open(path());
  EXPECT_EQ(remote->field().manifest(), local->manifest());
  EXPECT_EQ(remote->field().file_bytes(), local->file_bytes());
  Renderer renderer(remote->field());
  for (const unsigned level : {0u, 1u})
    for (const RenderMode mode : {RenderMode::nearest, RenderMode::bitri, RenderMode::depth}) {
      const auto image = renderer.render(camera(), {mode, level});
      ASSERT_TRUE(image) << image.error().message;
      EXPECT_EQ(image->rgba, testing::draw(*local, camera(), {mode, level}).rgba);
    }
  const RemoteTraffic traffic = remote->traffic();
  EXPECT_EQ(traffic.requests, host.requests());
  EXPECT_EQ(traffic.repeated, 0u);
  EXPECT_LT(traffic.bytes, content_.size());
}

TEST_F(RemoteTest, ReadsFieldsOfAllCodecs) {
  const auto field = Field::open(path());
  for (const char* const codec : {"raw", "jpeg:90"}) {
    const std::string recoded = *folder_ / "recoded.slf";
    RepackOptions options;
    options.codec = codec;
    options.replace = true;
    ASSERT_TRUE(repack_field(*field, recoded, options));
    const HttpHost host(content(recoded));
    const auto remote = RemoteField::open(host.url());
    ASSERT_TRUE(remote) << remote.error().message;
    Renderer renderer(remote->field(), {.memory = 8 << 20});
    const auto image = renderer.render(camera(), {RenderMode::depth, 1});
    ASSERT_TRUE(image) << image.error().message;
    EXPECT_EQ(image->rgba,
              testing::draw(*Field::open(recoded), camera(), {RenderMode::depth, 1}).rgba)
        << codec;
  }
}

TEST_F(RemoteTest, FetchesAViewTogether) {
  const HttpHost host(content_);
  const auto remote = RemoteField::open(host.url());
  ASSERT_TRUE(remote);
  EXPECT_LE(host.requests(), 4u);  // its length, its start, its end, the rest of the index
  Renderer renderer(remote->field());
  expect_picture(renderer.render(camera(), {RenderMode::depth, 1}));
  EXPECT_LE(host.requests(), 20u);
}

/// The balls, of which a plane leaves a part.
class CutBalls final : public Scene {
 public:
  [[nodiscard]] Sphere bounds() const override { return all_->bounds(); }
  [[nodiscard]] RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override {
    const RaySample sample = all_->trace(from, to);
    return (from + double{sample.depth} * (to - from)).z > 0.2 ? RaySample() : sample;
  }
  [[nodiscard]] std::string provenance() const override { return R"({"kind":"cut"})"; }

 private:
  std::unique_ptr<Scene> all_ = std::move(*make_analytic_scene("balls"));
};

/// Builds a field of two states, "whole" and "cut", of the shape of another but its levels.
void build_states(const std::string& file, FieldShape shape, unsigned levels) {
  const auto whole = make_analytic_scene("balls");
  const CutBalls cut;
  const std::vector<FieldState> states{{"whole", whole->get()}, {"cut", &cut}};
  BuildOptions options;
  options.shape = std::move(shape);
  options.shape.states = 1;
  options.shape.finest_level = levels;
  ASSERT_TRUE(build_field(states, file, options));
}

TEST_F(RemoteTest, DrawsAState) {
  const std::string file = *folder_ / "states.slf";
  build_states(file, Field::open(path())->shape(), 2);
  const HttpHost host(testing::read_text(file));
  const auto remote = RemoteField::open(host.url());
  ASSERT_TRUE(remote) << remote.error().message;
  const auto state = remote->field().in_state("cut");
  ASSERT_TRUE(state);
  const auto image = Renderer(*state).render(camera(), {RenderMode::depth, 2});
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_EQ(
      image->rgba,
      testing::draw(*Field::open(file)->in_state("cut"), camera(), {RenderMode::depth, 2}).rgba);
}

TEST_F(RemoteTest, StopsFetchingWhenTold) {
  const HttpHost host(content_);
  const auto remote = RemoteField::open(host.url());
  ASSERT_TRUE(remote);
  Renderer renderer(remote->field());
  const ViewOptions view{RenderMode::depth, 1};
  const auto stopped = renderer.render(camera(), view, nullptr, [](const Progress& progress) {
    EXPECT_EQ(progress.done, 0u);  // before anything is drawn
    return false;
  });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
  expect_picture(renderer.render(camera(), view));
}

TEST_F(RemoteTest, FetchesNothingTwice) {
  const HttpHost host(content_);
  const auto remote = RemoteField::open(host.url());
  ASSERT_TRUE(remote);
  const auto drawn = [&] {
    Renderer renderer(remote->field());
    return renderer.render(camera(), {RenderMode::depth, 1}).has_value();
  };
  ASSERT_TRUE(drawn());
  const unsigned requests = host.requests();
  ASSERT_TRUE(drawn());
  EXPECT_EQ(host.requests(), requests);
}

TEST_F(RemoteTest, DrawsAWarmViewOnce) {
  const HttpHost host(content_);
  const auto remote = RemoteField::open(host.url());
  ASSERT_TRUE(remote);
  const auto seconds = [&](const Field& field) {  // of this thread, which draws alone
    Renderer renderer(field, {.threads = 1});
    const Camera view = orbit_camera(field.shape().sphere, 30, 20, 3, 512, 512);
    double best = 1e9;
    for (int k = 0; k < 8; ++k) {
      timespec begin = {}, end = {};
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begin);
      EXPECT_TRUE(renderer.render(view, {RenderMode::depth, 1}));
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
      best = std::min(best, static_cast<double>(end.tv_sec - begin.tv_sec) +
                                1e-9 * static_cast<double>(end.tv_nsec - begin.tv_nsec));
    }
    return best;
  };
  EXPECT_LT(seconds(remote->field()), 1.6 * seconds(*Field::open(path())));
}

TEST_F(RemoteTest, RepacksAndVerifies) {
  const HttpHost host(content_);
  const auto remote = RemoteField::open(host.url());
  ASSERT_TRUE(remote);
  const auto report = verify_field(remote->field(), {});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->found, 0u);
  EXPECT_TRUE(report->complete);
  const std::string copy = *folder_ / "copy.slf";
  const auto repacked = repack_field(remote->field(), copy, RepackOptions());
  ASSERT_TRUE(repacked) << repacked.error().message;
  EXPECT_EQ(testing::all_tiles(*Field::open(copy)), testing::all_tiles(*Field::open(path())));
  EXPECT_LT(host.requests(), 60u);
}

TEST_F(RemoteTest, RepacksStatesAsTheyAre) {
  const std::string file = *folder_ / "lit.slf", copy = *folder_ / "lit-copy.slf";
  build_states(file, Field::open(path())->shape(), 1);
  {
    auto writer = storage::TileWriter::resume(file);
    ASSERT_TRUE(writer && writer->set_blob(kLightBlob, Bytes(20000, std::byte{7})));
    ASSERT_TRUE(writer->close());
  }
  const HttpHost host(testing::read_text(file));
  const auto remote = RemoteField::open(host.url());
  ASSERT_TRUE(remote);
  std::vector<StateSource> sources;
  for (const char* name : {"whole", "cut"})
    sources.push_back({name, *remote->field().in_state(name)});
  const auto done = join_states(sources, copy, {});
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_EQ(done->recoded, 0u);
  EXPECT_EQ(Field::open(copy)->light()->size(), 20000u);
  EXPECT_EQ(testing::all_tiles(*Field::open(copy)->in_state(1)),
            testing::all_tiles(*Field::open(file)->in_state(1)));
  EXPECT_LT(host.requests(), 60u);
}

TEST_F(RemoteTest, RepeatsWhatFails) {
  const auto twice = [](const Exchange& e) { return e.number == 1 || e.number == 5; };
  const HttpHost::Twist twists[] = {
      [&](Exchange& e) { e.stalls = twice(e); }, [&](Exchange& e) { e.hangs_up = twice(e); },
      [&](Exchange& e) {
        e.claimed = twice(e) ? static_cast<std::int64_t>(e.body.size() / 2) : -1;
      },
      [&](Exchange& e) {
        if (twice(e)) e.status = "503 Busy";
      },
      [&](Exchange& e) {
        if (twice(e)) e.status = "429 Slower", e.headers += "Retry-After: 1\r\n";
      }};
  for (const auto& twist : twists) {
    const HttpHost host(content_, twist);
    const auto remote = RemoteField::open(host.url(), kImpatient);
    ASSERT_TRUE(remote) << remote.error().message;
    Renderer renderer(remote->field());
    expect_picture(renderer.render(camera(), {RenderMode::depth, 1}));
    EXPECT_GT(remote->traffic().repeated, 0u) << &twist - twists;
  }
}

TEST_F(RemoteTest, GivesUp) {
  expect_error(HttpHost(content_, [](Exchange& e) { e.stalls = true; }), ErrorCode::io,
               "after 3 attempts");
  expect_error(HttpHost(content_, [](Exchange& e) { e.hangs_up = true; }), ErrorCode::io,
               "after 3 attempts");
  expect_error(HttpHost(content_, [](Exchange& e) { e.status = "503 Busy"; }), ErrorCode::io,
               "the server answers 503, after 3 attempts");
  // From the middle of a picture on.
  expect_error(HttpHost(content_, [](Exchange& e) { e.hangs_up = e.number > 4; }), ErrorCode::io,
               "after 3 attempts");
}

TEST_F(RemoteTest, RefusesWhatIsNoPartOfTheFile) {
  expect_error(HttpHost(content_, [](Exchange& e) { e.headers = ""; }), ErrorCode::io,
               "does not say which part");
  expect_error(HttpHost(content_,
                        [](Exchange& e) {
                          e.headers = "ETag: \"1\"\r\nContent-Range: bytes 0-1/99999999\r\n";
                        }),
               ErrorCode::io, "another part of the file");
  expect_error(HttpHost(content_, [](Exchange& e) { e.body += "more"; }), ErrorCode::io,
               "more than it was asked for");
  expect_error(HttpHost(content_, [](Exchange& e) { e.status = "404 Not Found"; }),
               ErrorCode::not_found, "answers 404");
  expect_error(HttpHost(std::string(20000, 'x')), ErrorCode::bad_file, "not a field");
  expect_error(HttpHost("x"), ErrorCode::bad_file, "not a field");
  expect_error(HttpHost(content_.substr(0, content_.size() / 2)), ErrorCode::bad_file, "truncated");
}

/// Answers every request with the whole file, as some hosts do.
HttpHost::Twist whole(const std::string& content) {
  return [&content](Exchange& e) {
    e.status = "200 OK";
    e.headers = "ETag: \"1\"\r\n";
    e.body = content;
  };
}

TEST_F(RemoteTest, FetchesASmallFieldWholeWhereThereAreNoRanges) {
  const HttpHost host(content_, whole(content_));
  std::uint64_t done = 0, total = 0;
  const auto remote = RemoteField::open(host.url(), kImpatient, [&](const Progress& progress) {
    done = progress.done;
    total = progress.total;
    return true;
  });
  ASSERT_TRUE(remote) << remote.error().message;
  EXPECT_EQ(done, content_.size());
  EXPECT_EQ(total, content_.size());
  Renderer renderer(remote->field());
  expect_picture(renderer.render(camera(), {RenderMode::depth, 1}));
  EXPECT_EQ(host.requests(), 2u);  // one to learn it
  const auto stopped =
      RemoteField::open(host.url(), kImpatient, [](const Progress&) { return false; });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
}

TEST_F(RemoteTest, SaysWhatTheHostOfALargeFieldLacks) {
  const auto with_length = [&](std::int64_t length) {
    return [length](Exchange& e) {
      e.status = "200 OK";
      e.claimed = length;
    };
  };
  const HttpHost large(content_, with_length((64 << 20) + 1));
  expect_error(large, ErrorCode::unsupported, "does not serve parts of files");
  expect_error(large, ErrorCode::unsupported, "67108865 bytes");
  EXPECT_LT(large.sent(), 1u << 20);
  const HttpHost endless(content_, [&](Exchange& e) {
    e.status = "200 OK";
    e.claimed = HttpHost::kUnstated;
    e.endless = true;
    e.body = std::string(1 << 20, 'x');
  });
  expect_error(endless, ErrorCode::unsupported, "67108864 is fetched whole");
}

// libcurl, which calls it, is C.
TEST_F(RemoteTest, ReportsWhatAProgressCallbackThrows) {
  const HttpHost host(content_, whole(content_));
  const auto remote = RemoteField::open(host.url(), kImpatient, [](const Progress&) -> bool {
    throw std::runtime_error("thrown by a callback");
  });
  ASSERT_FALSE(remote);
  EXPECT_EQ(remote.error().code, ErrorCode::failed);
  EXPECT_THAT(remote.error().message, HasSubstr("thrown by a callback"));
}

TEST_F(RemoteTest, FetchesAgainAfterASinkHasThrown) {
  const HttpHost host(content_);
  const auto source = HttpSource::open(host.url(), kImpatient, {});
  ASSERT_TRUE(source);
  std::vector<storage::FileRange> ranges;
  for (std::uint64_t at = 0; at + 8000 < content_.size(); at += 40000)
    ranges.push_back({at, at + 8000});
  for (int k = 0; k < 5; ++k)
    EXPECT_THROW(
        (void)(*source)->fetch(
            ranges, [](std::uint64_t, ByteSpan) -> Result<void> { throw std::bad_alloc(); }),
        std::bad_alloc);
  std::size_t right = 0;
  ASSERT_TRUE((*source)->fetch(ranges, [&](std::uint64_t offset, ByteSpan bytes) -> Result<void> {
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    right += text == std::string_view(content_).substr(offset, 8000);
    return {};
  }));
  EXPECT_EQ(right, ranges.size());
}

// Nothing needs the text of an error, nor of a redirection.
TEST_F(RemoteTest, DoesNotReadEndlessErrors) {
  for (const std::int64_t length : {HttpHost::kUnstated, std::int64_t{1} << 40})
    for (const char* const status : {"404 Not Found", "302 Found"}) {
      const HttpHost host(content_, [&](Exchange& e) {
        e.status = status;
        e.headers = "Location: /again\r\n";
        e.claimed = length;
        e.endless = true;
        e.body = std::string(1 << 20, 'x');
      });
      if (status[0] == '4')
        expect_error(host, ErrorCode::not_found, "answers 404");
      else
        expect_error(host, ErrorCode::io, "the server ");
      EXPECT_LE(host.requests(), 6u) << status;
      EXPECT_LT(host.sent(), 64u << 20) << status;
    }
}

TEST_F(RemoteTest, ReadsAddressesAsPeopleWriteThem) {
  std::string asked;
  const HttpHost host(content_, [&](Exchange& e) { asked = e.path; });
  for (const auto& [path, escaped] : {std::pair<std::string, std::string>{"/a b.slf", "/a%20b.slf"},
                                      {"/caf\u00e9.slf?x=1 2", "/caf%c3%a9.slf?x=1+2"},
                                      {"/a%20b.slf", "/a%20b.slf"}}) {
    std::string url = host.url(path);
    url.replace(0, 4, "HTTP");
    EXPECT_TRUE(is_address(url));
    const auto remote = RemoteField::open(url, kImpatient);
    ASSERT_TRUE(remote) << remote.error().message;
    EXPECT_EQ(asked, escaped);
  }
  EXPECT_TRUE(is_address("Https://example.org/a.slf"));
  for (const char* const path : {"http", "http:/a", "file:///a", "a/http://b", ""})
    EXPECT_FALSE(is_address(path)) << path;
}

TEST_F(RemoteTest, NoticesThatTheFileChanges) {
  const auto other = [](Exchange& e) {
    if (e.number > 4) e.headers.replace(e.headers.find("\"1\""), 3, "\"2\"");
  };
  expect_error(HttpHost(content_, other), ErrorCode::bad_file, "has changed on the server");
  const auto fails = [](Exchange& e) {
    if (e.number > 4) {
      EXPECT_EQ(e.if_match, "\"1\"");
      e.status = "412 Precondition Failed";
    }
  };
  expect_error(HttpHost(content_, fails), ErrorCode::bad_file, "has changed on the server");
}

// Two fields of equal length, on a host that tells neither ETag nor date, or the same date for
// both.
TEST_F(RemoteTest, NoticesThatAFileIsSwappedWhoseVersionNobodyTells) {
  const auto build = [](const std::string& name, bool inverted) {
    const testing::FunctionScene scene([&](const glm::dvec3& from, const glm::dvec3& to) {
      const float v = 0.5f + 0.4f * static_cast<float>(std::sin(9 * from.x + 7 * to.y));
      return RaySample{glm::vec4(glm::vec3(inverted ? 1 - v : v), 1), 0.5f};
    });
    BuildOptions options = testing::lossless_options(4, 8, 1);
    options.codec = "raw";
    EXPECT_TRUE(build_field(scene, *folder_ / name, options));
    EXPECT_TRUE(index_field(*folder_ / name));
    return content(*folder_ / name);
  };
  const std::string mine = build("swap-a.slf", false), other = build("swap-b.slf", true);
  ASSERT_EQ(mine.size(), other.size());
  const auto drawn = [](const std::string& name) {
    const auto field = Field::open(*folder_ / name);
    return testing::draw(*field, camera(), {RenderMode::depth, 1}).rgba;
  };
  const auto mine_drawn = drawn("swap-a.slf"), other_drawn = drawn("swap-b.slf");
  ASSERT_NE(mine_drawn, other_drawn);
  for (const char* const date : {"", "Last-Modified: Tue, 01 Jan 2030 00:00:00 GMT\r\n"}) {
    // From each request on: while the file is opened, and between and within fetches.
    unsigned last = 100, refused = 0;
    for (unsigned swapped = 1; swapped < last; ++swapped) {
      HttpHost* at = nullptr;
      HttpHost host(mine, [&](Exchange& e) {
        e.headers = date + at->content_range(e.begin, e.end);
        if (e.number >= swapped) e.body = other.substr(e.begin, e.end - e.begin);
      });
      at = &host;
      const auto image = draw(host);
      if (host.requests() <= swapped) last = swapped;
      if (!image) {
        EXPECT_EQ(image.error().code, ErrorCode::bad_file) << image.error().message;
        ++refused;
      } else {
        // Requests race, so the last of them may be for pages that both files share.
        EXPECT_TRUE(image->rgba == mine_drawn || image->rgba == other_drawn) << swapped;
      }
    }
    EXPECT_GT(refused, 5u);
    EXPECT_LT(last, 100u);
  }
}

TEST_F(RemoteTest, NoticesDamage) {
  // Beyond what the index has: payloads only.
  const HttpHost host(content_, [&](Exchange& e) {
    if (e.number > 3)
      for (char& c : e.body) c = static_cast<char>(c ^ 1);
  });
  const auto image = draw(host);
  ASSERT_FALSE(image);
  EXPECT_EQ(image.error().code, ErrorCode::bad_file);
}

TEST_F(RemoteTest, FollowsRedirectsButNotForEver) {
  const HttpHost good(content_);
  const HttpHost moved("", [&](Exchange& e) {
    e.status = "302 Found", e.headers = "Location: " + good.url() + "\r\n", e.body = "";
  });
  expect_picture(draw(moved));
  const HttpHost loop("", [](Exchange& e) {
    e.status = "302 Found", e.headers = "Location: /again\r\n", e.body = "";
  });
  expect_error(loop, ErrorCode::io, "redirects more than");
  const HttpHost local("", [](Exchange& e) {
    e.status = "302 Found", e.headers = "Location: file:///etc/passwd\r\n", e.body = "";
  });
  expect_error(local, ErrorCode::io, "without http or https");
  EXPECT_EQ(local.requests(), 1u);
}

TEST(RemoteField, SaysThatNothingAnswers) {
  const auto remote = RemoteField::open("http://127.0.0.1:1/field.slf", kImpatient);
  ASSERT_FALSE(remote);
  EXPECT_EQ(remote.error().code, ErrorCode::io);
}

TEST(RemoteField, GivesUpWhereLibcurlHasNoMemory) {
  ASSERT_TRUE(load_curl());
  auto& library = const_cast<CurlLibrary&>(curl);
  const auto expect_failure = [&](auto CurlLibrary::*function, auto instead) {
    const auto before = std::exchange(library.*function, instead);
    const auto remote = RemoteField::open("http://127.0.0.1:9/a.slf", kImpatient);
    library.*function = before;
    ASSERT_FALSE(remote);
    EXPECT_EQ(remote.error().code, ErrorCode::failed);
    EXPECT_THAT(remote.error().message, HasSubstr("memory"));
  };
  expect_failure(&CurlLibrary::easy_init, []() -> CURL* { return nullptr; });
  expect_failure(&CurlLibrary::multi_init, []() -> CURLM* { return nullptr; });
  expect_failure(&CurlLibrary::url, []() -> CURLU* { return nullptr; });
  expect_failure(&CurlLibrary::multi_add_handle, [](CURLM*, CURL*) { return CURLM_OUT_OF_MEMORY; });
  expect_failure(&CurlLibrary::multi_perform, [](CURLM*, int*) { return CURLM_OUT_OF_MEMORY; });
}

TEST(RemoteField, LoadsLibcurlForAddressesOnly) {
  const testing::Workplace place;
  testing::write_text(place / "libcurl.so.4", "not a library\n");
  const std::string instead = "LD_LIBRARY_PATH=" + testing::shell_quoted(place.path());
  EXPECT_OUTCOME(testing::slf({"render", testing::kGoldenField, "-o", place / "view.png"}, instead),
                 0, "");
  EXPECT_OUTCOME(testing::slf({"info", "http://127.0.0.1:1/field.slf"}, instead), 5,
                 "http://127.0.0.1:1/field.slf: reading over HTTP needs libcurl (Debian's package "
                 "libcurl4)");
}

}  // namespace
}  // namespace slf
