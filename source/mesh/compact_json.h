// JSON text as simdjson reads it, in 14 times its bytes at most: the objects of the library that
// other rooms use take up to 40 times as much. Private to source/mesh.
#pragma once

#include <simdjson.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

namespace slf {

/// A value, or none. Asking one of another kind for something gives none, too. Valid as long as its
/// text.
class JsonValue {
 public:
  JsonValue() = default;
  explicit JsonValue(const simdjson::dom::element& element) : element_(element) {}
  [[nodiscard]] explicit operator bool() const { return element_.has_value(); }
  /// Of an object; only the first 1000 members are looked at, so that time is linear.
  [[nodiscard]] JsonValue operator[](std::string_view member) const;
  [[nodiscard]] std::vector<JsonValue> items() const;
  [[nodiscard]] std::string_view text() const { return get<std::string_view>().value_or(""); }
  [[nodiscard]] std::optional<double> number() const { return get<double>(); }
  /// A number that is an index or a count.
  [[nodiscard]] std::optional<std::uint64_t> index() const;
  [[nodiscard]] bool is_true() const { return get<bool>().value_or(false); }

 private:
  template <class T>
  [[nodiscard]] std::optional<T> get() const {
    T value{};
    if (!element_ || element_->get(value) != simdjson::SUCCESS) return {};
    return value;
  }
  std::optional<simdjson::dom::element> element_;
};

class CompactJson {
 public:
  /// None: it is no JSON. Throws std::bad_alloc.
  [[nodiscard]] static std::optional<CompactJson> parse(std::string_view text);
  [[nodiscard]] JsonValue root() const { return root_; }

 private:
  std::unique_ptr<simdjson::dom::parser> parser_;
  JsonValue root_;
};

}  // namespace slf
