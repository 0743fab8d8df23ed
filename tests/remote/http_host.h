// HttpHost: a web server of one file that misbehaves as a test wants.
#pragma once

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <list>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

namespace slf::testing {

class HttpHost {
 public:
  static constexpr std::int64_t kUnstated = -2;

  /// A request, and its answer as a good server would give it. A test changes the answer.
  struct Exchange {
    unsigned number = 0;  ///< of the request, from 0
    std::string path;
    std::uint64_t begin = 0, end = 0;
    std::string if_match;
    // The answer:
    std::string status = "206 Partial Content";
    std::string headers;  ///< whole lines; without Content-Length
    std::string body;
    std::int64_t claimed = -1;  ///< Content-Length, if it is not the body's; kUnstated: none
    bool endless = false;       ///< sends the body again and again
    bool stalls = false;        ///< sends half of the body, and nothing more
    bool hangs_up = false;      ///< sends half of the body, and closes the connection
  };
  using Twist = std::function<void(Exchange&)>;

  explicit HttpHost(std::string content, Twist twist = {})
      : content_(std::move(content)), twist_(std::move(twist)) {
    listener_ = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), size) != 0 ||
        ::listen(listener_, 64) != 0 ||
        ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0)
      std::perror("HttpHost");
    port_ = ntohs(address.sin_port);
    acceptor_ = std::thread([this] { accept(); });
  }
  HttpHost(const HttpHost&) = delete;
  HttpHost& operator=(const HttpHost&) = delete;
  ~HttpHost() {
    stop_ = true;
    ::shutdown(listener_, SHUT_RDWR);
    acceptor_.join();
    {
      const std::lock_guard lock(mutex_);
      for (Peer& peer : peers_) ::shutdown(peer.socket, SHUT_RDWR);
    }
    for (Peer& peer : peers_) {
      peer.thread.join();
      ::close(peer.socket);
    }
    ::close(listener_);
  }

  [[nodiscard]] std::string url(const std::string& path = "/field.slf") const {
    return "http://127.0.0.1:" + std::to_string(port_) + path;
  }
  [[nodiscard]] unsigned requests() const { return requests_; }
  [[nodiscard]] std::uint64_t sent() const { return sent_; }

 private:
  struct Peer {
    int socket;
    std::thread thread;
  };

  void accept() {
    for (int peer; (peer = ::accept(listener_, nullptr, nullptr)) >= 0 && !stop_;) {
      const std::lock_guard lock(mutex_);
      peers_.push_back({peer, {}});
      peers_.back().thread = std::thread([this, peer] { serve(peer); });
    }
  }

  static std::string header(const std::string& head, const std::string& name) {
    const std::size_t at = head.find("\r\n" + name + ": ");
    if (at == std::string::npos) return "";
    const std::size_t begin = at + name.size() + 4;
    return head.substr(begin, head.find("\r\n", begin) - begin);
  }

  void serve(int peer) {
    std::string head;
    for (char piece[4096]; !stop_;) {
      const ssize_t got = ::recv(peer, piece, sizeof piece, 0);
      if (got <= 0) return;
      head.append(piece, static_cast<std::size_t>(got));
      if (!head.ends_with("\r\n\r\n")) continue;
      if (!answer(peer, head)) {
        ::shutdown(peer, SHUT_RDWR);
        return;
      }
      head.clear();
    }
  }

  bool answer(int peer, const std::string& head) {
    Exchange e;
    e.number = requests_++;
    e.path = head.substr(4, head.find(" HTTP/") - 4);
    unsigned long long first = 0, last = 0;
    (void)std::sscanf(header(head, "Range").c_str(), "bytes=%llu-%llu", &first, &last);
    e.begin = std::min<std::uint64_t>(first, content_.size());
    e.end = std::min<std::uint64_t>(last + 1, content_.size());
    e.if_match = header(head, "If-Match");
    e.headers = "ETag: \"1\"\r\n" + content_range(e.begin, e.end);
    e.body = content_.substr(e.begin, e.end - e.begin);
    if (twist_) {
      const std::lock_guard lock(mutex_);
      twist_(e);
    }
    std::string answer = "HTTP/1.1 " + e.status + "\r\n" + e.headers;
    if (e.claimed != kUnstated)
      answer +=
          "Content-Length: " +
          std::to_string(e.claimed < 0 ? static_cast<std::int64_t>(e.body.size()) : e.claimed) +
          "\r\n";
    answer += "\r\n";
    const bool part = e.stalls || e.hangs_up;
    if (!send(peer, answer + e.body.substr(0, e.body.size() / (part ? 2 : 1)))) return false;
    while (e.endless)
      if (!send(peer, e.body)) return false;
    return !e.hangs_up;
  }

  bool send(int peer, const std::string& bytes) {
    for (std::size_t at = 0; at < bytes.size();) {
      const ssize_t put = ::send(peer, bytes.data() + at, bytes.size() - at, MSG_NOSIGNAL);
      if (put <= 0) return false;
      at += static_cast<std::size_t>(put);
      sent_ += static_cast<std::uint64_t>(put);
    }
    return true;
  }

 public:
  [[nodiscard]] std::string content_range(std::uint64_t begin, std::uint64_t end) const {
    return "Content-Range: bytes " + std::to_string(begin) + "-" + std::to_string(end - 1) + "/" +
           std::to_string(content_.size()) + "\r\n";
  }

 private:
  const std::string content_;
  const Twist twist_;
  int listener_ = -1;
  std::uint16_t port_ = 0;
  std::atomic<bool> stop_{false};
  std::atomic<unsigned> requests_{0};
  std::atomic<std::uint64_t> sent_{0};
  std::mutex mutex_;  // of peers_, and of the twist
  std::list<Peer> peers_;
  std::thread acceptor_;
};

}  // namespace slf::testing
