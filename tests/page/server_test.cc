// The server that shows fields: what it sends, and what it refuses. Requests go over real sockets,
// byte for byte, so that wrong ones can be sent.

#include "page/server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "page/page.h"
#include "page/ranges.h"

namespace slf::page {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

const std::string kField = SLF_TEST_DATA "/golden/example.slf";

std::string content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class RunningServer {
 public:
  explicit RunningServer(std::vector<std::string> fields = {kField}, ServerOptions options = {}) {
    auto server = Server::make(fields, options);
    EXPECT_TRUE(server) << (server ? "" : server.error().message);
    url = server->url();
    port = static_cast<std::uint16_t>(std::stoi(url.substr(url.find(':', 5) + 1)));
    thread_ = std::thread([this, s = std::move(*server)]() mutable {
      const auto done = s.run([this] { return stop_.load(); });
      EXPECT_TRUE(done) << done.error().message;
    });
  }
  ~RunningServer() {
    stop_ = true;
    thread_.join();
  }

  [[nodiscard]] int connect() const {
    const int peer = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
    EXPECT_EQ(::connect(peer, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    const timeval patience = {10, 0};
    setsockopt(peer, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    return peer;
  }

  /// Sends bytes and returns all that comes until the server closes. `ends`: nothing more follows,
  /// and the server need not wait for it.
  [[nodiscard]] std::string send(const std::string& bytes, bool ends = false) const {
    const int peer = connect();
    (void)::send(peer, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (ends) shutdown(peer, SHUT_WR);
    std::string answer;
    std::array<char, 65536> piece;
    for (ssize_t got; (got = recv(peer, piece.data(), piece.size(), 0)) > 0;)
      answer.append(piece.data(), static_cast<std::size_t>(got));
    close(peer);
    return answer;
  }

  /// "/TOKEN"
  [[nodiscard]] std::string root() const {
    const std::size_t begin = url.find('/', 8);
    return url.substr(begin, url.find('/', begin + 1) - begin);
  }

  [[nodiscard]] std::string host() const { return "127.0.0.1:" + std::to_string(port); }

  /// Of a path behind the token.
  [[nodiscard]] std::string get(const std::string& path, const std::string& headers = "",
                                const std::string& method = "GET") const {
    return get_any(root() + path, headers, method);
  }
  [[nodiscard]] std::string get_any(const std::string& path, const std::string& headers = "",
                                    const std::string& method = "GET") const {
    return send(method + " " + path + " HTTP/1.1\r\nHost: " + host() + "\r\nConnection: close\r\n" +
                headers + "\r\n");
  }

  std::string url;
  std::uint16_t port = 0;

 private:
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

std::string body(const std::string& answer) { return answer.substr(answer.find("\r\n\r\n") + 4); }

std::string header(const std::string& answer, const std::string& name) {
  const std::size_t at = answer.find("\r\n" + name + ": ");
  if (at == std::string::npos || at > answer.find("\r\n\r\n")) return "";
  const std::size_t begin = at + name.size() + 4;
  return answer.substr(begin, answer.find("\r\n", begin) - begin);
}

TEST(ViewServer, SendsTheWholeField) {
  const RunningServer server;
  const std::string answer = server.get("/example/field.slf");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_EQ(header(answer, "Accept-Ranges"), "bytes");
  EXPECT_NE(header(answer, "ETag"), "");
  EXPECT_EQ(header(answer, "Cache-Control"), "no-cache");
  EXPECT_EQ(body(answer), content(kField));
}

TEST(ViewServer, SendsRanges) {
  const RunningServer server;
  const std::string all = content(kField), size = std::to_string(all.size());
  const auto expect = [&](const std::string& range, std::size_t begin, std::size_t end) {
    const std::string answer = server.get("/example/field.slf", "Range: " + range + "\r\n");
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 206")) << range;
    EXPECT_EQ(header(answer, "Content-Range"),
              "bytes " + std::to_string(begin) + "-" + std::to_string(end - 1) + "/" + size)
        << range;
    EXPECT_EQ(header(answer, "Content-Length"), std::to_string(end - begin)) << range;
    EXPECT_EQ(body(answer), all.substr(begin, end - begin)) << range;
  };
  expect("bytes=0-0", 0, 1);
  expect("bytes=4096-8191", 4096, 8192);
  expect("bytes=100-", 100, all.size());
  expect("bytes=-100", all.size() - 100, all.size());
  expect("bytes=-999999999", 0, all.size());
  expect("bytes=5-9223372036854775807", 5, all.size());
  expect("bytes=" + std::to_string(all.size() - 1) + "-", all.size() - 1, all.size());
}

TEST(ViewServer, SendsSeveralRangesOfThePagesFilesToo) {
  if (page_files().empty()) GTEST_SKIP() << no_page();
  const RunningServer server;
  const std::string whole = body(server.get("/example/style.css"));
  const std::string answer = server.get("/example/style.css", "Range: bytes=0-0,200-200\r\n");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 206"));
  EXPECT_THAT(header(answer, "Content-Type"), StartsWith("multipart/byteranges"));
  EXPECT_THAT(body(answer), HasSubstr("Content-Range: bytes 200-200/" +
                                      std::to_string(whole.size()) + "\r\n\r\n" + whole[200]));
}

TEST(ViewServer, SendsSeveralRangesInOneAnswer) {
  const RunningServer server;
  const std::string all = content(kField), size = std::to_string(all.size());
  const std::string answer =
      server.get("/example/field.slf", "Range: bytes=0-9,4000-4999, 999999999-,-5\r\n");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 206"));
  EXPECT_EQ(header(answer, "Content-Type"), "multipart/byteranges; boundary=slf-part");
  std::string expected;
  for (const auto& [begin, end] :
       {std::pair<std::size_t, std::size_t>{0, 10}, {4000, 5000}, {all.size() - 5, all.size()}})
    expected +=
        "\r\n--slf-part\r\nContent-Type: application/octet-stream\r\nContent-Range: bytes " +
        std::to_string(begin) + "-" + std::to_string(end - 1) + "/" + size + "\r\n\r\n" +
        all.substr(begin, end - begin);
  EXPECT_EQ(body(answer), expected + "\r\n--slf-part--\r\n");
  EXPECT_EQ(header(answer, "Content-Length"), std::to_string(body(answer).size()));
}

// More work than the file is worth: the whole file instead.
TEST(ViewServer, DoesNotSendAFileManyTimesOver) {
  const RunningServer server;
  std::string many = "bytes=0-0";
  for (int i = 1; i <= 200; ++i) many += "," + std::to_string(2 * i) + "-" + std::to_string(2 * i);
  for (const std::string& range : {std::string("bytes=0-,0-"), many})
    EXPECT_THAT(server.get("/example/field.slf", "Range: " + range + "\r\n"),
                StartsWith("HTTP/1.1 200"));
}

TEST(ViewServer, RefusesRangesBehindTheEnd) {
  const RunningServer server;
  const std::string size = std::to_string(content(kField).size());
  for (const std::string& range :
       {"bytes=" + size + "-", std::string("bytes=99999999-999999999"), std::string("bytes=-0")}) {
    const std::string answer = server.get("/example/field.slf", "Range: " + range + "\r\n");
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 416")) << range;
    EXPECT_EQ(header(answer, "Content-Range"), "bytes */" + size) << range;
  }
}

TEST(ViewServer, AnswersHeadWithoutABody) {
  const RunningServer server;
  const std::string whole = server.get("/example/field.slf", "", "HEAD");
  EXPECT_THAT(whole, StartsWith("HTTP/1.1 200"));
  EXPECT_EQ(header(whole, "Content-Length"), std::to_string(content(kField).size()));
  EXPECT_EQ(body(whole), "");
  const std::string part = server.get("/example/field.slf", "Range: bytes=0-9\r\n", "HEAD");
  EXPECT_EQ(header(part, "Content-Length"), "10");
  EXPECT_EQ(body(part), "");
}

TEST(ViewServer, KnowsWhatThePeerHas) {
  const RunningServer server;
  const std::string tag = header(server.get("/example/field.slf"), "ETag");
  const std::string same = server.get("/example/field.slf", "If-None-Match: " + tag + "\r\n");
  EXPECT_THAT(same, StartsWith("HTTP/1.1 304"));
  EXPECT_EQ(body(same), "");
  EXPECT_THAT(server.get("/example/field.slf", "If-Match: \"other\"\r\n"),
              StartsWith("HTTP/1.1 412"));
  const std::string range = "Range: bytes=0-9\r\n";
  EXPECT_THAT(server.get("/example/field.slf", range + "If-Range: " + tag + "\r\n"),
              StartsWith("HTTP/1.1 206"));
  EXPECT_THAT(server.get("/example/field.slf", range + "If-Range: \"other\"\r\n"),
              StartsWith("HTTP/1.1 200"));
}

TEST(ViewServer, ATagChangesWithTheFile) {
  const std::string path = ::testing::TempDir() + "changing.slf";
  std::ofstream(path, std::ios::binary) << content(kField);
  const RunningServer server({path});
  const std::string before = header(server.get("/changing/field.slf"), "ETag");
  std::ofstream(path, std::ios::binary | std::ios::app) << "more";
  EXPECT_NE(header(server.get("/changing/field.slf"), "ETag"), before);
}

// As a build or repack replaces it: another file gets its name.
TEST(ViewServer, SendsTheFieldThatHasTheNameNow) {
  const std::string path = ::testing::TempDir() + "replaced.slf";
  std::ofstream(path, std::ios::binary) << content(kField);
  const RunningServer server({path});
  const std::string before = header(server.get("/replaced/field.slf"), "ETag");
  std::ofstream(path + ".new", std::ios::binary) << std::string(content(kField).size(), 'n');
  std::filesystem::last_write_time(path + ".new", std::filesystem::last_write_time(path));
  std::filesystem::rename(path + ".new", path);
  const std::string answer = server.get("/replaced/field.slf");
  EXPECT_EQ(body(answer), content(path));
  EXPECT_NE(header(answer, "ETag"), before);
  EXPECT_THAT(server.get("/replaced/field.slf", "If-Match: " + before + "\r\n"),
              StartsWith("HTTP/1.1 412"));
  std::filesystem::remove(path);
  EXPECT_THAT(server.get("/replaced/field.slf"), StartsWith("HTTP/1.1 500"));
}

TEST(ViewServer, ClosesTheConnectionsOfHttp10) {
  const RunningServer server;
  const std::string answer = server.send("GET " + server.root() +
                                         "/example/field.slf HTTP/1.0\r\nHost: localhost\r\n\r\n");
  EXPECT_EQ(body(answer), content(kField));
}

TEST(ViewServer, AnswersAllRequestsThatComeAtOnce) {
  const RunningServer server;
  const std::string all = content(kField);
  std::string requests, expected;
  for (int i = 0; i < 200; ++i) {
    requests += "GET " + server.root() + "/example/field.slf HTTP/1.1\r\nHost: " + server.host() +
                "\r\nRange: bytes=" + std::to_string(i) + "-" + std::to_string(i) + "\r\n" +
                (i == 199 ? "Connection: close\r\n" : "") + "\r\n";
    expected += all[static_cast<std::size_t>(i)];
  }
  const std::string answers = server.send(requests);
  std::string bodies;
  for (std::size_t at = 0; (at = answers.find("\r\n\r\n", at)) != std::string::npos; at += 5)
    bodies += answers[at + 4];
  EXPECT_EQ(bodies, expected);
}

TEST(ViewServer, TakesNoBodyForARequest) {
  const RunningServer server;
  const std::string inner =
      "GET " + server.root() + "/example/field.slf HTTP/1.1\r\nHost: " + server.host() + "\r\n\r\n";
  const std::string answer =
      server.send("POST / HTTP/1.1\r\nHost: " + server.host() +
                  "\r\nContent-Length: " + std::to_string(inner.size()) + "\r\n\r\n" + inner);
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 405"));
  EXPECT_EQ(answer.find("HTTP/1.1", 1), std::string::npos);
}

TEST(ViewServer, RefusesRequestsThatOthersReadDifferently) {
  const RunningServer server;
  const std::string start = "GET " + server.root() + "/example/field.slf HTTP/1.1\r\n",
                    host = "Host: " + server.host();
  const std::string inner = start + host + "\r\n\r\n";
  const std::string chunked = "Transfer-Encoding : chunked\r\n\r\n";
  for (const std::string& request :
       {start + host + "\r\n" + chunked + inner, start + host + "\r\n " + chunked + inner,
        start + host + "\r\nA: b\nTransfer-Encoding: chunked\r\n\r\n" + inner,
        start + host + "\r\nA: b\r" + chunked + inner, start + host + "\r\nTwo words\r\n\r\n",
        start + "Host: localhost" + std::string(1, '\0') + ".evil.example\r\n\r\n",
        start + "Host: localhost" + std::string(1, '\0') + "\r\n\r\n",
        "GET  /example/field.slf HTTP/1.1\r\n" + host + "\r\n\r\n"}) {
    const std::string answer = server.send(request);
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 400")) << request;
    EXPECT_EQ(answer.find("HTTP/1.1", 1), std::string::npos) << request;
  }
  const std::string answer =
      server.send(start + host + "\r\nTransfer-Encoding: chunked\r\n\r\n" + inner);
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_EQ(header(answer, "Connection"), "close");
  EXPECT_EQ(body(answer), content(kField));
  EXPECT_THAT(server.send("GET /" + std::string(20000, 'a') + " HTTP/1.1\r\n"),
              StartsWith("HTTP/1.1 431"));
}

// Peers that ask for nothing, for half of something, or do not read the answer.
TEST(ViewServer, AnswersAtOnceAmongManyPeersThatStall) {
  const std::string path = ::testing::TempDir() + "long.slf";
  std::ofstream(path, std::ios::binary) << content(kField);
  std::filesystem::resize_file(path, 64 << 20);  // more than sockets take
  const RunningServer server({kField, path});
  for (const std::string& sent : {std::string(), std::string("GET /"),
                                  "GET " + server.root() + "/long/field.slf HTTP/1.1\r\nHost: " +
                                      server.host() + "\r\n\r\n"}) {
    std::vector<int> peers;
    for (int i = 0; i < 300; ++i) {
      peers.push_back(server.connect());
      (void)::send(peers.back(), sent.data(), sent.size(), MSG_NOSIGNAL);
    }
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_EQ(body(server.get("/example/field.slf")), content(kField));
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(2)) << sent;
    for (const int peer : peers) close(peer);
  }
}

TEST(ViewServer, ClosesConnectionsThatStall) {
  const RunningServer server;
  const int peer = server.connect();
  for (int i = 0; i < 80; ++i) {  // a letter at a time, for 8 s
    if (::send(peer, "G", 1, MSG_NOSIGNAL) != 1) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  char c = 0;
  EXPECT_LE(recv(peer, &c, 1, MSG_DONTWAIT), 0);
  EXPECT_NE(errno, EAGAIN);
  close(peer);
}

TEST(ViewServer, AnswersToItsOwnNamesOnly) {
  const RunningServer server;
  const auto status = [&](const std::string& host) {
    return server
        .send("GET " + server.root() + "/example/field.slf HTTP/1.1\r\nConnection: close\r\n" +
              host + "\r\n")
        .substr(0, 12);
  };
  const std::string port = ":" + std::to_string(server.port);
  EXPECT_EQ(status("Host: 127.0.0.1" + port + "\r\n"), "HTTP/1.1 200");
  EXPECT_EQ(status("Host: localhost" + port + "\r\n"), "HTTP/1.1 200");
  EXPECT_EQ(status("Host: attacker.example" + port + "\r\n"), "HTTP/1.1 403");
  // Something else forwards another port to this one.
  EXPECT_EQ(status("Host: localhost:9999\r\n"), "HTTP/1.1 200");
  EXPECT_EQ(status("Host: [::1]:9999\r\n"), "HTTP/1.1 200");
  EXPECT_EQ(status("Host: 127.0.0.1\r\n"), "HTTP/1.1 200");
  EXPECT_EQ(status("Host: 127.0.0.1.attacker.example\r\n"), "HTTP/1.1 403");
  EXPECT_EQ(status("Host: localhost:80.attacker.example\r\n"), "HTTP/1.1 403");
  EXPECT_THAT(server.get("/", "Host: attacker.example\r\n"), HasSubstr("--bind"));
  EXPECT_EQ(status("Host: 127.0.0.1" + port + "\r\nHost: attacker.example\r\n"), "HTTP/1.1 403");
  EXPECT_EQ(status(""), "HTTP/1.1 403");
  ServerOptions open;
  open.any_host = true;
  const RunningServer other({kField}, open);
  EXPECT_THAT(other.send("GET " + other.root() +
                         "/example/field.slf HTTP/1.1\r\nHost: any.example\r\n"
                         "Connection: close\r\n\r\n"),
              StartsWith("HTTP/1.1 200"));
}

TEST(ViewServer, AnswersToThoseWhoKnowItsTokenOnly) {
  const RunningServer server, other;
  const std::string root = server.root();
  ASSERT_EQ(root.size(), 33u);
  EXPECT_NE(root, other.root());
  EXPECT_THAT(server.url, HasSubstr(root + "/example/"));
  std::string wrong = root;
  wrong.back() = wrong.back() == '0' ? '1' : '0';
  for (const std::string& path :
       {std::string("/"), std::string("/example/"), std::string("/example/field.slf"),
        std::string("/example/style.css"), wrong + "/example/", other.root() + "/example/",
        root.substr(0, 32), root.substr(0, 32) + "/example/", "/" + root, std::string("*"),
        "/example/" + root.substr(1) + "/field.slf"}) {
    const std::string answer = server.get_any(path);
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 403")) << path;
    EXPECT_THAT(body(answer), HasSubstr("token")) << path;
    EXPECT_THAT(answer, Not(HasSubstr(root))) << path;
  }
  EXPECT_EQ(header(server.get_any(root), "Location"), root.substr(1) + "/");
  EXPECT_THAT(server.get_any(root + "/example/field.slf"), StartsWith("HTTP/1.1 200"));
}

TEST(ViewServer, GivesAnAddressThatWorksWhenItListensOnAll) {
  for (const char* const all : {"0.0.0.0", "::"}) {
    ServerOptions options;
    options.address = all;
    options.any_host = true;
    const auto server = Server::make(std::vector<std::string>{kField}, options);
    if (!server && options.address == "::") GTEST_SKIP() << server.error().message;
    ASSERT_TRUE(server) << server.error().message;
    EXPECT_THAT(server->url(), Not(HasSubstr("/" + options.address + ":")));
    EXPECT_THAT(server->url(), Not(HasSubstr("[::]")));
  }
}

TEST(ViewServer, SendsNothingElse) {
  const RunningServer server;
  for (const char* path :
       {"/../../etc/passwd", "/example/../../etc/passwd", "/example/%2e%2e/example.slf",
        "/example/example.slf", "/example/field.slf/", "//example/field.slf", "/example//field.slf",
        "/Example/field.slf", "/example/.", "/etc/passwd", "/example/field.slf%00"})
    EXPECT_THAT(server.get(path), StartsWith("HTTP/1.1 404")) << path;
  for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "PATCH"}) {
    const std::string answer = server.get("/example/field.slf", "", method);
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 405")) << method;
    EXPECT_EQ(header(answer, "Allow"), "GET, HEAD");
  }
}

TEST(ViewServer, ForbidsWhatThePageDoesNotNeed) {
  const RunningServer server;
  for (const char* path : {"/", "/example/", "/example/field.slf", "/nothing"}) {
    const std::string answer = server.get(path);
    EXPECT_THAT(header(answer, "Content-Security-Policy"), StartsWith("default-src 'none';"));
    EXPECT_THAT(header(answer, "Content-Security-Policy"), Not(HasSubstr("unsafe-inline")));
    EXPECT_EQ(header(answer, "X-Content-Type-Options"), "nosniff");
  }
}

// tests/page/notebook_test.py has a browser judge it.
TEST(ViewServer, LetsNotebooksOfThisMachineAndOriginsThatAreNamedFrameIt) {
  ServerOptions options;
  options.frames = {"https://hub.example.org", "http://lab.example.org:*"};
  const RunningServer server({kField}, options);
  EXPECT_THAT(header(server.get("/example/"), "Content-Security-Policy"),
              ::testing::EndsWith("; frame-ancestors 'self' http://localhost:* http://127.0.0.1:* "
                                  "https://hub.example.org http://lab.example.org:*"));
  for (const char* const wrong :
       {"*", "https:", "https://*", "hub.example.org", "https://a b", "https://a;", "https://a/",
        "https://a:", "https://a:x", "https://", "'none'", "https://a,b", "", "data:"}) {
    options.frames = {wrong};
    const auto made = Server::make(std::vector<std::string>{kField}, options);
    ASSERT_FALSE(made) << wrong;
    EXPECT_EQ(made.error().code, ErrorCode::usage);
    EXPECT_THAT(made.error().message, HasSubstr("not an origin"));
  }
}

TEST(ViewServer, SendsThePage) {
  const RunningServer server;
  EXPECT_EQ(header(server.get("/"), "Location"), "example/");
  EXPECT_EQ(header(server.get("/example"), "Location"), "example/");
  if (page_files().empty()) GTEST_SKIP() << no_page();
  EXPECT_EQ(body(server.get("/example/")), page_files()[0].bytes);
  for (const PageFile& file : page_files()) {
    const std::string answer = server.get("/example/" + std::string(file.name));
    EXPECT_EQ(header(answer, "Content-Type"), file.type);
    EXPECT_EQ(body(answer), file.bytes) << file.name;
  }
}

TEST(ViewServer, ListsSeveralFields) {
  const RunningServer server({kField, kField});
  EXPECT_THAT(server.get("/"), HasSubstr("<a href=\"example-2/\">"));
  EXPECT_EQ(body(server.get("/example-2/field.slf")), content(kField));
}

TEST(ViewServer, RefusesWhatIsNoField) {
  EXPECT_EQ(Server::make(std::vector<std::string>{"/nonexistent.slf"}, {}).error().code,
            ErrorCode::not_found);
  EXPECT_EQ(Server::make(std::vector<std::string>{"/etc/passwd"}, {}).error().code,
            ErrorCode::bad_file);
  EXPECT_EQ(Server::make({}, {}).error().code, ErrorCode::usage);
}

TEST(ViewServer, SaysThatAPortIsTaken) {
  const RunningServer server;
  ServerOptions options;
  options.port = server.port;
  const auto second = Server::make(std::vector<std::string>{kField}, options);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::io);
  EXPECT_THAT(second.error().message, HasSubstr(std::to_string(server.port)));
}

TEST(ViewServer, SurvivesMalformedRequests) {
  const RunningServer server;
  const std::string good = "GET " + server.root() +
                           "/example/field.slf HTTP/1.1\r\nHost: " + server.host() +
                           "\r\nRange: bytes=1-5\r\n\r\n";
  std::vector<std::string> bad = {
      "",
      "\r\n\r\n",
      "GET",
      "GET / HTTP/9.9\r\n\r\n",
      std::string(100, '\0'),
      "GET " + std::string(20000, 'a') + " HTTP/1.1\r\n\r\n",
      "GET / HTTP/1.1\r\nHost: " + server.host() + "\r\nA: " + std::string(20000, 'b') + "\r\n\r\n",
      "GET / HTTP/1.1\r\nHost: " + server.host() + "\r\nRange: bytes=" + std::string(5000, '9') +
          "-\r\n\r\n",
      "GET / HTTP/1.1\r\nHost: " + server.host() + "\r\nRange: bytes=" +
          [] {
            std::string many = "0-0";
            for (int i = 0; i < 1500; ++i) many += ",0-0";
            return many;
          }() +
          "\r\n\r\n",
      "POST / HTTP/1.1\r\nHost: " + server.host() + "\r\nContent-Length: 99999999999\r\n\r\nabc",
      "POST / HTTP/1.1\r\nHost: " + server.host() + "\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n"};
  std::mt19937 random(1);
  for (int i = 0; i < 2000; ++i) {
    std::string request = good;
    const int changes = 1 + static_cast<int>(random() % 4);
    for (int k = 0; k < changes; ++k)
      request[random() % request.size()] = static_cast<char>(random());
    if (i % 3 == 0) request.resize(random() % request.size());
    bad.push_back(request);
  }
  for (const std::string& request : bad) (void)server.send(request, true);
  EXPECT_EQ(body(server.get("/example/field.slf")), content(kField));
}

/// Ranges of a file, in all forms, some after its end.
std::string well_formed_ranges(std::mt19937& random, std::size_t file) {
  std::string header = "bytes=";
  const std::size_t count = 1 + random() % 4;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t first = random() % (file + file / 4), last = first + random() % 5000;
    if (i > 0) header += random() % 2 == 0 ? "," : ", ";
    switch (random() % 4) {
      case 0:
        header += "-" + std::to_string(last % 5000);
        break;
      case 1:
        header += std::to_string(first) + "-";
        break;
      default:
        header += std::to_string(first) + "-" + std::to_string(last);
    }
  }
  return header;
}

TEST(ViewServer, IgnoresRangesThatAreMalformed) {
  const RunningServer server;
  for (const char* const range :
       {"bytes=a-b", "bytes=-", "bytes=5", "bytes=1-2,x", "lines=1-2", "bytes=9-8", ""}) {
    const std::string answer =
        server.get("/example/field.slf", "Range: " + std::string(range) + "\r\n");
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 200")) << range;
    EXPECT_EQ(body(answer), content(kField)) << range;
  }
}

// What select_ranges() says decides.
TEST(ViewServer, AnyRangeHeaderGetsThePartsThatItNames) {
  const RunningServer server;
  const std::string all = content(kField);
  constexpr std::string_view kCharacters = "0123456789--,,  =x";
  std::mt19937 random(2);
  for (int i = 0; i < 3000 && !HasFailure(); ++i) {
    const bool well_formed = i % 2 == 0;
    std::string range = "bytes=";
    if (well_formed)
      range = well_formed_ranges(random, all.size());
    else
      for (std::size_t left = random() % 24; left > 0; --left)
        range += kCharacters[random() % kCharacters.size()];
    if (i % 16 == 1) range[random() % range.size()] = '=';
    const std::string answer = server.get("/example/field.slf", "Range: " + range + "\r\n");
    SCOPED_TRACE(range);
    range.resize(range.find_last_not_of(' ') + 1);  // as the server reads headers
    const auto parts = select_ranges(range, all.size());
    if (answer.starts_with("HTTP/1.1 416")) {
      EXPECT_TRUE(parts && parts->empty());
    } else if (!parts) {
      EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
      EXPECT_EQ(body(answer), all);
    } else {
      EXPECT_THAT(answer, StartsWith("HTTP/1.1 206"));
      EXPECT_EQ(header(answer, "Content-Length"), std::to_string(body(answer).size()));
      for (const FilePart& part : *parts)
        EXPECT_THAT(body(answer), HasSubstr(all.substr(part.first, part.size)));
      if (parts->size() == 1) {
        EXPECT_EQ(body(answer).size(), parts->front().size);
      }
    }
  }
}

TEST(ViewServer, ServesOthersWhileSomeStall) {
  const RunningServer server;
  std::vector<int> idle;
  for (int i = 0; i < 16; ++i) {
    idle.push_back(server.connect());
    (void)::send(idle.back(), "GET /", 5, MSG_NOSIGNAL);
  }
  EXPECT_EQ(body(server.get("/example/field.slf")), content(kField));
  for (const int peer : idle) close(peer);
}

}  // namespace
}  // namespace slf::page
