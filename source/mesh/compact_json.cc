#include "source/mesh/compact_json.h"

#include <cmath>
#include <new>

namespace slf {

JsonValue JsonValue::operator[](std::string_view member) const {
  simdjson::dom::object members;
  if (!element_ || element_->get(members) != simdjson::SUCCESS) return {};
  int count = 0;
  for (const auto& [key, value] : members) {
    if (key == member) return JsonValue(value);
    if (++count == 1000) break;
  }
  return {};
}

std::vector<JsonValue> JsonValue::items() const {
  std::vector<JsonValue> items;
  simdjson::dom::array values;
  if (element_ && element_->get(values) == simdjson::SUCCESS)
    for (const auto& value : values) items.emplace_back(value);
  return items;
}

std::optional<std::uint64_t> JsonValue::index() const {
  const auto value = number();
  if (!value || !(*value >= 0 && *value <= 0x1p53) || *value != std::floor(*value)) return {};
  return static_cast<std::uint64_t>(*value);
}

std::optional<CompactJson> CompactJson::parse(std::string_view text) {
  CompactJson json;
  json.parser_ = std::make_unique<simdjson::dom::parser>();
  simdjson::dom::element root;
  const auto error = json.parser_->parse(text.data(), text.size()).get(root);
  if (error == simdjson::MEMALLOC) throw std::bad_alloc();
  if (error != simdjson::SUCCESS) return {};
  json.root_ = JsonValue(root);
  return json;
}

}  // namespace slf
