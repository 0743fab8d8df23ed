// Reports: what commands print and Python returns. Each is a struct that describes its members
// once, from which its JSON, the schema of that, and a named tuple of Python follow:
//
//   void describe(auto& member) const {
//     member("file_bytes", file_bytes, "of the output");
//   }
//
// `member` takes a name, the value, a line of help with the unit, and what else the schema says, as
// text: R"("minimum": 1)". A pointer is a member that is left out if it is null; an empty optional
// is null. A struct that Python has, too, has its name there as `kPython`.
#pragma once

#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <ranges>
#include <string>
#include <string_view>
#include <type_traits>

namespace slf::report {

/// The name of a member in JSON and in Python; null: it is not there.
struct Name {
  Name(const char* both) : json(both), python(both) {}
  Name(const char* in_json, const char* in_python) : json(in_json), python(in_python) {}
  const char *json, *python;
};

/// A number of dB in JSON, which has no infinity.
inline constexpr const char* kOrNull = R"("type": ["number", "null"])";

struct AnyMember {
  void operator()(const Name&, const auto&, const char*, const char* = "") {}
};
template <class T>
concept Report = requires(const T& report, AnyMember& member) {
  report.describe(member);
};
template <class T>
concept Text = std::is_convertible_v<T, std::string_view>;
/// A member that may be left out.
template <class T>
concept Pointer = std::is_pointer_v<T> && !Text<T>;
template <class T>
using Value = std::conditional_t<Pointer<T>, std::remove_cv_t<std::remove_pointer_t<T>>, T>;
template <class T>
concept Optional = std::is_same_v<T, std::optional<typename T::value_type>>;
template <class T>
concept Vector = requires(const T& v) {
  v.x + v.y + v.z;
};
template <class T>
concept Map = requires {
  typename T::mapped_type;
};
template <class T>
concept List = std::ranges::range<T> && !Text<T> && !Map<T> && !std::is_same_v<T, nlohmann::json>;

/// JSON whose schema is that of a T.
template <class T>
struct Typed {
  nlohmann::json value;
};

// ---- JSON ---------------------------------------------------------------------------------------

template <class T>
[[nodiscard]] nlohmann::json json_of(const T& value);

struct JsonMember {
  template <class T>
  void operator()(const Name& name, const T& value, const char*, const char* = "") {
    if (!name.json) return;
    if constexpr (Pointer<T>) {
      if (value) json[name.json] = json_of(*value);
    } else {
      json[name.json] = json_of(value);
    }
  }
  nlohmann::json json = nlohmann::json::object();
};

/// The JSON of a report, or of a member. Numbers that are not finite are null.
template <class T>
nlohmann::json json_of(const T& value) {
  if constexpr (Report<T>) {
    JsonMember member;
    value.describe(member);
    return std::move(member.json);
  } else if constexpr (Optional<T>) {
    return value ? json_of(*value) : nlohmann::json();
  } else if constexpr (std::is_floating_point_v<T>) {
    return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
  } else if constexpr (Vector<T>) {
    return {value.x, value.y, value.z};
  } else if constexpr (List<T>) {
    nlohmann::json list = nlohmann::json::array();
    for (const auto& one : value) list.push_back(json_of(one));
    return list;
  } else if constexpr (requires { value.value.is_null(); }) {
    return value.value;
  } else {
    return value;
  }
}

struct LineMember {
  template <class T>
  void operator()(const Name& name, const T& value, const char*, const char* = "") {
    if (!name.json) return;
    line.append(line.empty() ? "{\"" : ", \"").append(name.json).append("\": ");
    if constexpr (std::is_integral_v<T>)
      line += std::to_string(value);
    else
      line += json_of(value).dump();
  }
  std::string line;
};

/// The JSON of a report as a line, in the order of its members; ten times as fast as json_of().
template <class T>
[[nodiscard]] std::string line_of(const T& report) {
  LineMember member;
  report.describe(member);
  return member.line + "}";
}

// ---- schemas ------------------------------------------------------------------------------------

template <class T>
[[nodiscard]] nlohmann::json schema_of();

struct SchemaMember {
  template <class T>
  void operator()(const Name& name, const T&, const char* help, const char* more = "") {
    if (!name.json) return;
    nlohmann::json member = schema_of<Value<T>>();
    if (*help) member["description"] = help;
    member.update(nlohmann::json::parse("{" + std::string(more) + "}"));
    schema["properties"][name.json] = std::move(member);
    if constexpr (!Pointer<T>) schema["required"].push_back(name.json);
  }
  nlohmann::json schema{{"type", "object"}, {"additionalProperties", false}};
};

/// The JSON Schema (draft 7) of a report, or of a member.
template <class T>
nlohmann::json schema_of() {
  using nlohmann::json;
  if constexpr (Report<T>) {
    SchemaMember member;
    T{}.describe(member);
    return std::move(member.schema);
  } else if constexpr (Optional<T>) {
    json schema = schema_of<typename T::value_type>();
    schema["type"] = {schema["type"], "null"};
    return schema;
  } else if constexpr (std::is_same_v<T, bool>) {
    return {{"type", "boolean"}};
  } else if constexpr (std::is_unsigned_v<T>) {
    return {{"type", "integer"}, {"minimum", 0}};
  } else if constexpr (std::is_integral_v<T>) {
    return {{"type", "integer"}};
  } else if constexpr (std::is_floating_point_v<T>) {
    return {{"type", "number"}};
  } else if constexpr (Text<T>) {
    return {{"type", "string"}};
  } else if constexpr (Vector<T>) {
    return schema_of<std::array<double, 3>>();
  } else if constexpr (Map<T>) {
    return {{"type", "object"}, {"additionalProperties", schema_of<typename T::mapped_type>()}};
  } else if constexpr (List<T>) {
    json schema{{"type", "array"}, {"items", schema_of<std::ranges::range_value_t<T>>()}};
    if constexpr (requires { std::tuple_size<T>::value; })
      schema["minItems"] = schema["maxItems"] = std::tuple_size_v<T>;
    return schema;
  } else if constexpr (std::is_same_v<T, json>) {
    return json::object();
  } else {
    return []<class U>(const Typed<U>*) { return schema_of<U>(); }(static_cast<T*>(nullptr));
  }
}

}  // namespace slf::report
