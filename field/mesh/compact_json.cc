#include "field/mesh/compact_json.h"

#include <cmath>
#include <nlohmann/json.hpp>

namespace slf {

/// What nlohmann's parser, which needs no stack, calls.
struct CompactJson::Builder : nlohmann::json_sax<nlohmann::json> {
  CompactJson& to;
  std::vector<std::uint32_t> open;
  explicit Builder(CompactJson& json) : to(json) {}

  bool add(Kind kind, double number = 0) {
    to.nodes_.push_back({kind, static_cast<std::uint32_t>(to.nodes_.size() + 1), {number}});
    return true;
  }
  bool null() override { return add(Kind::null); }
  bool boolean(bool value) override { return add(value ? Kind::yes : Kind::no); }
  bool number_integer(std::int64_t v) override { return add(Kind::number, static_cast<double>(v)); }
  bool number_unsigned(std::uint64_t v) override {
    return add(Kind::number, static_cast<double>(v));
  }
  bool number_float(double v, const std::string& /*text*/) override { return add(Kind::number, v); }
  bool string(std::string& text) override {
    add(Kind::text);
    to.nodes_.back().text = {static_cast<std::uint32_t>(to.characters_.size()),
                             static_cast<std::uint32_t>(text.size())};
    to.characters_ += text;
    return true;
  }
  bool key(std::string& text) override { return string(text); }
  bool binary(nlohmann::json::binary_t& /*bytes*/) override { return false; }
  bool start(Kind kind) {
    open.push_back(static_cast<std::uint32_t>(to.nodes_.size()));
    return add(kind);
  }
  bool finish() {
    to.nodes_[open.back()].end = static_cast<std::uint32_t>(to.nodes_.size());
    open.pop_back();
    return true;
  }
  bool start_object(std::size_t /*members*/) override { return start(Kind::object); }
  bool end_object() override { return finish(); }
  bool start_array(std::size_t /*items*/) override { return start(Kind::array); }
  bool end_array() override { return finish(); }
  bool parse_error(std::size_t /*at*/, const std::string& /*token*/,
                   const nlohmann::detail::exception& /*why*/) override {
    return false;
  }
};

std::optional<CompactJson> CompactJson::parse(std::string_view text) {
  CompactJson json;
  json.nodes_.reserve(text.size() / 8);
  Builder builder(json);
  if (!nlohmann::json::sax_parse(text, &builder)) return {};
  return json;
}

JsonValue JsonValue::operator[](std::string_view member) const {
  if (!text_ || text_->nodes_[at_].kind != CompactJson::Kind::object) return {};
  const std::size_t end = text_->nodes_[at_].end;
  std::size_t at = at_ + 1;
  for (int k = 0; k < 1000 && at < end; ++k, at = text_->nodes_[at + 1].end)
    if (JsonValue(*text_, at).text() == member) return {*text_, at + 1};
  return {};
}

std::vector<JsonValue> JsonValue::items() const {
  std::vector<JsonValue> items;
  if (!text_ || text_->nodes_[at_].kind != CompactJson::Kind::array) return items;
  for (std::size_t at = at_ + 1; at < text_->nodes_[at_].end; at = text_->nodes_[at].end)
    items.push_back({*text_, at});
  return items;
}

bool JsonValue::is_text() const {
  return text_ && text_->nodes_[at_].kind == CompactJson::Kind::text;
}

std::string_view JsonValue::text() const {
  if (!is_text()) return {};
  const auto& place = text_->nodes_[at_].text;
  return std::string_view(text_->characters_).substr(place.at, place.length);
}

std::optional<double> JsonValue::number() const {
  if (!text_ || text_->nodes_[at_].kind != CompactJson::Kind::number) return {};
  return text_->nodes_[at_].number;
}

std::optional<std::uint64_t> JsonValue::index() const {
  const auto value = number();
  if (!value || !(*value >= 0 && *value <= 0x1p53) || *value != std::floor(*value)) return {};
  return static_cast<std::uint64_t>(*value);
}

bool JsonValue::is_true() const {
  return text_ && text_->nodes_[at_].kind == CompactJson::Kind::yes;
}

}  // namespace slf
