// OwnedJson: a JSON value whose end takes no memory.
//
// The destructor of nlohmann::json first moves all that a value holds into a list, and there is no
// way back if there is no memory for that list: the program ends. A value that is emptied from the
// inside out needs none. Initializer lists make and destroy such values, too: assign members; and
// assign json::object() first, because [] and push_back leave a null value broken if they fail.
#pragma once

#include <nlohmann/json.hpp>
#include <utility>

namespace slf {

class OwnedJson {
 public:
  OwnedJson(nlohmann::json json = {}) : json_(std::move(json)) {}  // NOLINT: like a smart pointer
  OwnedJson(const OwnedJson&) = default;
  OwnedJson(OwnedJson&&) = default;
  OwnedJson& operator=(OwnedJson other) noexcept {
    json_.swap(other.json_);
    return *this;
  }
  ~OwnedJson() { empty(json_); }  // NOLINT(bugprone-exception-escape): see empty()
  friend bool operator==(const OwnedJson&, const OwnedJson&) = default;

  [[nodiscard]] const nlohmann::json& operator*() const { return json_; }
  [[nodiscard]] nlohmann::json& operator*() { return json_; }
  [[nodiscard]] const nlohmann::json* operator->() const { return &json_; }
  [[nodiscard]] nlohmann::json* operator->() { return &json_; }

 private:
  // NOLINTNEXTLINE(bugprone-exception-escape): no part of a value of a known type throws
  static void empty(nlohmann::json& json) noexcept {
    if (!json.is_structured()) return;
    for (nlohmann::json& inner : json) empty(inner);
    json.clear();
  }

  nlohmann::json json_;
};

}  // namespace slf
