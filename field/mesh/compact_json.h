// JSON text as a list of small nodes, 16 bytes for each value: the library's own objects take up to
// 40 times as much memory as a hostile text has bytes. Private to field/mesh.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace slf {

/// A value, or none. Asking one of another kind for something gives none, too. Valid as long as its
/// text.
class JsonValue {
 public:
  JsonValue() = default;
  [[nodiscard]] explicit operator bool() const { return text_ != nullptr; }
  /// Of an object; only the first 1000 members are looked at, so that time is linear.
  [[nodiscard]] JsonValue operator[](std::string_view member) const;
  [[nodiscard]] std::vector<JsonValue> items() const;
  [[nodiscard]] bool is_text() const;
  [[nodiscard]] std::string_view text() const;
  [[nodiscard]] std::optional<double> number() const;
  /// A number that is an index or a count.
  [[nodiscard]] std::optional<std::uint64_t> index() const;
  [[nodiscard]] bool is_true() const;

 private:
  friend class CompactJson;
  JsonValue(const class CompactJson& text, std::size_t at) : text_(&text), at_(at) {}
  const class CompactJson* text_ = nullptr;
  std::size_t at_ = 0;
};

class CompactJson {
 public:
  /// None: it is no JSON.
  [[nodiscard]] static std::optional<CompactJson> parse(std::string_view text);
  [[nodiscard]] JsonValue root() const { return {*this, 0}; }

 private:
  friend class JsonValue;
  struct Builder;
  enum class Kind : std::uint8_t { null, yes, no, number, text, array, object };
  struct Node {
    Kind kind;
    std::uint32_t end;  // the node after this one and all that is in it
    union {
      double number;
      struct {
        std::uint32_t at, length;
      } text;
    };
  };
  std::vector<Node> nodes_;  // members of objects: a text, then the value
  std::string characters_;
};

}  // namespace slf
