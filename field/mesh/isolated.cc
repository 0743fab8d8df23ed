#include "field/mesh/isolated.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <type_traits>
#include <vector>

#include "base/child_process.h"
#include "base/file.h"
#include "base/guarded.h"
#include "base/try.h"
#include "field/mesh/surface.h"

namespace slf {
namespace {

constexpr std::uint64_t kMaxElements = std::uint64_t{1} << 30;  // of one list
constexpr std::size_t kAllocated = std::size_t{1} << 20;        // bytes allocated at once
constexpr std::uint8_t kMesh = 1, kError = 2, kEnd = 0x5a;

/// What both ends do with a mesh, in the same order: `end` sends or receives each value.
template <class End, class M>
void exchange(End& end, M& mesh) {
  end.text(mesh.source);
  end.list(mesh.positions);
  end.list(mesh.normals);
  end.list(mesh.uvs);
  end.list(mesh.colors);
  end.list(mesh.triangles);
  end.list(mesh.material_of);
  end.items(mesh.materials, [&](auto& m) {
    end.text(m.name);
    end.value(m.color);
    std::uint64_t texture = m.texture ? *m.texture + 1 : 0;
    end.value(texture);
    if constexpr (End::kReceives) {
      m.texture.reset();
      if (texture > 0) m.texture = texture - 1;
    }
    std::uint8_t flags = static_cast<std::uint8_t>((m.repeat_u ? 1 : 0) | (m.repeat_v ? 2 : 0) |
                                                   (static_cast<unsigned>(m.opacity) << 2));
    end.value(flags);
    if constexpr (End::kReceives) {
      m.repeat_u = (flags & 1) != 0;
      m.repeat_v = (flags & 2) != 0;
      const unsigned opacity = flags >> 2;
      if (opacity > static_cast<unsigned>(MeshOpacity::blend)) end.fail();
      m.opacity = static_cast<MeshOpacity>(opacity & 3);
    }
    end.value(m.cutoff);
  });
  end.items(mesh.textures, [&](auto& t) {
    end.text(t.name);
    end.value(t.width);
    end.value(t.height);
    end.list(t.texels);
  });
  end.items(mesh.files, [&](auto& text) { end.text(text); });
  end.items(mesh.notes, [&](auto& text) { end.text(text); });
}

/// In the child.
class Sender {
 public:
  static constexpr bool kReceives = false;
  explicit Sender(int to) : to_(to) {}
  [[nodiscard]] bool good() const { return good_; }

  void bytes(const void* from, std::size_t size) {
    good_ = good_ && write_all(to_, {static_cast<const std::byte*>(from), size}) == 0;
  }
  template <class T>
  void value(const T& value) {
    bytes(&value, sizeof value);
  }
  void text(const std::string& text) {
    value(std::uint64_t{text.size()});
    bytes(text.data(), text.size());
  }
  /// Frees what was sent, so that both processes together hold a mesh about once.
  template <class T>
  void list(std::vector<T>& values) {
    value(std::uint64_t{values.size()});
    bytes(values.data(), values.size() * sizeof(T));
    std::vector<T>().swap(values);
  }
  template <class T, class Each>
  void items(std::vector<T>& items, const Each& each) {
    value(std::uint64_t{items.size()});
    for (T& item : items) each(item);
  }

 private:
  int to_;
  bool good_ = true;
};

/// In the parent. Memory grows with the bytes that arrive.
class Receiver {
 public:
  static constexpr bool kReceives = true;
  explicit Receiver(int from) : from_(from) {}
  [[nodiscard]] bool good() const { return good_; }
  /// Whether nothing more came.
  [[nodiscard]] bool ended() const { return ended_; }
  void fail() { good_ = false; }

  void bytes(void* to, std::size_t size) {
    char* at = static_cast<char*>(to);
    while (good_ && size > 0) {
      const ssize_t got = ::read(from_, at, size);
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) {
        ended_ = true;
        return fail();
      }
      at += got;
      size -= static_cast<std::size_t>(got);
    }
  }
  template <class T>
  void value(T& value) {
    bytes(&value, sizeof value);
  }
  void text(std::string& text) { list(text); }
  template <class T>
  void list(T& values) {
    using Element = typename T::value_type;
    static_assert(std::is_trivially_copyable_v<Element>);
    const std::uint64_t count = count_of();
    values.clear();
    while (good_ && values.size() < count) {
      const std::size_t have = values.size();
      const std::size_t more = std::min<std::uint64_t>(count - have, kAllocated / sizeof(Element));
      // As push_back() would, but no more than is announced.
      if (values.capacity() < have + more)
        values.reserve(std::min<std::uint64_t>(count, std::max(2 * have, have + more)));
      values.resize(have + more);
      bytes(values.data() + have, more * sizeof(Element));
    }
  }
  template <class T, class Each>
  void items(std::vector<T>& items, const Each& each) {
    const std::uint64_t count = count_of();
    for (std::uint64_t k = 0; good_ && k < count; ++k) each(items.emplace_back());
  }

 private:
  std::uint64_t count_of() {
    std::uint64_t count = 0;
    value(count);
    if (count > kMaxElements) fail();
    return good_ ? count : 0;
  }
  int from_;
  bool good_ = true, ended_ = false;
};

[[noreturn]] void be_child(int to, pid_t parent, std::uint64_t bytes, std::uint64_t seconds,
                           const std::function<Result<Mesh>()>& read) noexcept {
  // It ends with its parent.
  if (::prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || ::getppid() != parent) ::_exit(1);
  if (!guarded([&] { confine_child(bytes, seconds); })) ::_exit(1);
  auto mesh = guarded(read);
  Sender end(to);
  const auto sent = guarded([&] {
    if (mesh) {
      end.value(kMesh);
      exchange(end, *mesh);
    } else {
      end.value(kError);
      end.value(static_cast<int>(mesh.error().code));
      end.text(mesh.error().message);
    }
    end.value(kEnd);
  });
  ::_exit(sent && end.good() ? 0 : 1);
}

/// What the child sent; none: it ended before it sent all. bad_file: it contradicts itself.
std::optional<Result<Mesh>> receive(int from, const std::string& path) {
  Receiver end(from);
  std::uint8_t kind = 0, last = 0;
  end.value(kind);
  Result<Mesh> result;
  if (kind == kMesh) {
    exchange(end, *result);
    if (end.good() && !check_mesh(*result)) end.fail();  // the child may have been taken over
  } else {
    int code = 0;
    std::string message;
    end.value(code);
    end.text(message);
    if (kind != kError || code < 0 || code > static_cast<int>(ErrorCode::differs)) end.fail();
    result = tl::unexpected<Error>(Error{static_cast<ErrorCode>(code), message, {}});
  }
  end.value(last);
  if (end.ended()) return std::nullopt;
  if (!end.good() || last != kEnd)
    return fail(ErrorCode::bad_file, path, ": its reader sent a mesh that contradicts itself");
  return result;
}

}  // namespace

Result<Mesh> read_isolated(const std::string& path, std::uint64_t bytes, std::uint64_t seconds,
                           const std::function<Result<Mesh>()>& read) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0)
    return fail(ErrorCode::failed, path, ": no pipe to its reader: ", std::strerror(errno));
  const pid_t parent = ::getpid();
  const pid_t child = ::fork();
  if (child == 0) {
    ::close(ends[0]);
    be_child(ends[1], parent, bytes, seconds, read);
  }
  const int error = errno;
  ::close(ends[1]);
  if (child < 0) {
    ::close(ends[0]);
    return fail(ErrorCode::failed, path, ": no process to read it: ", std::strerror(error));
  }
  auto received =
      guarded([&]() -> Result<std::optional<Result<Mesh>>> { return receive(ends[0], path); });
  ::close(ends[0]);  // so that a child that still sends ends
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (!received) return tl::unexpected(received.error());
  if (*received) return std::move(**received);
  if (WIFEXITED(status) && WEXITSTATUS(status) == kNotConfined) return not_confined(path);
  const int signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  if (signal == SIGINT || signal == SIGTERM || signal == SIGKILL)
    return fail(ErrorCode::failed, path, ": its reader was killed: ", ::strsignal(signal));
  if (signal == SIGXCPU)
    return fail(ErrorCode::bad_file, path, ": was not read within ", seconds,
                " s: it is damaged, or too large");
  if (signal != 0)
    return fail(ErrorCode::bad_file, path, ": crashes its reader (", ::strsignal(signal),
                "): it is damaged; repair the mesh, or export it again");
  return fail(ErrorCode::bad_file, path, ": its reader ended unexpectedly (status ",
              WEXITSTATUS(status), ")");
}

}  // namespace slf
