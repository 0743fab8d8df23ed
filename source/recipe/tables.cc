// What is made of the table of options: a JSON Schema, and the keywords of Python.
#include <algorithm>

#include "base/join.h"
#include "source/recipe/options.h"

namespace slf::recipe {
namespace {

using nlohmann::json;
using Form = Type::Form;

json number_schema(const Type& type, const char* kind) {
  json out{{"type", kind}};
  if (type.low > -1e100) out[type.above ? "exclusiveMinimum" : "minimum"] = type.low;
  if (type.high < 1e100) out["maximum"] = type.high;
  return out;
}

json list_of(const json& items, std::size_t count) {
  json out{{"type", "array"}, {"items", items}};
  if (count > 0) out["minItems"] = out["maxItems"] = count;
  return out;
}

json schema_of(const Type& type) {
  switch (type.form) {
    case Form::flag:
      return {{"type", "boolean"}};
    case Form::whole:
      return number_schema(type, "integer");
    case Form::number:
      return number_schema(type, "number");
    case Form::bytes:
      return {{"type", {"integer", "string"}}};
    case Form::text:
      return {{"type", "string"}};
    case Form::file:
      return {{"type", {"string", "object"}}};
    case Form::choice:
      return {{"enum", type.names}};
    case Form::numbers:
      return list_of(number_schema(type, "number"), type.count);
    case Form::wholes:
      return list_of(number_schema(type, "integer"), type.count);
    case Form::planes:
      return list_of(list_of(number_schema(type, "number"), 6), 0);
    case Form::box:
      return list_of(list_of({{"type", {"integer", "null"}}}, 2), 3);
  }
  return {};
}

const char* python_type(const Option& option) {
  switch (option.type.form) {
    case Form::flag:
      return option.in_memory ? "Any" : "bool";
    case Form::whole:
      return "int | None";
    case Form::number:
      return "float | None";
    case Form::bytes:
      return "int | str | None";
    case Form::text:
    case Form::choice:
      return "str | None";
    case Form::file:
      return "Any";
    case Form::numbers:
      return "Sequence[float] | None";
    case Form::wholes:
      return "Sequence[int] | None";
    case Form::planes:
      return "Sequence[Sequence[float]]";
    case Form::box:
      return "Sequence[Sequence[int | None]] | None";
  }
  return "Any";
}

void add_class(std::string& out, const char* name, const char* help,
               std::span<const Option> options, std::initializer_list<Use> uses) {
  out += concat("\n\nclass ", name, "(TypedDict, total=False):\n    \"\"\"", help, "\"\"\"\n\n");
  for (const Option& option : options) {
    if (std::ranges::find(uses, option.use) == uses.end()) continue;
    std::string text = help_of(option, false);
    if (option.kinds != kAny && option.kinds != kVolume && option.kinds != (kVolume | kMesh))
      text = concat("Of ", option.kinds == kMesh ? "meshes" : "pictures", ". ", text);
    out += concat("    ", option.name, ": ", python_type(option), "\n    \"\"\"",
                  filled(text, 96, 7, "    "), ".\"\"\"\n");
  }
}

}  // namespace

json schema(std::span<const Option> options) {
  json members = json::object();
  for (const Option& option : options) {
    json member = schema_of(option.type);
    member["description"] = help_of(option, false);
    if (option.otherwise && !option.otherwise->empty()) member["default"] = *option.otherwise;
    members[option.name] = std::move(member);
  }
  json state = members;
  state["name"] = {{"type", "string"},
                   {"minLength", 1},
                   {"description", "By which --state chooses it; no other state has it"}};
  state["light_from"] = {
      {"type", "string"},
      {"description",
       "An earlier state, which differs by clip or structures alone: this state has its light, but "
       "for what is laid open"}};
  state["time"] = {{"oneOf", {members["time"], {{"const", "all"}}}},
                   {"description", "all: a state of each time point, \"NAME 0\", \"NAME 1\", ..."}};
  json recipe = members;
  recipe["states"] = list_of({{"type", "object"},
                              {"required", {"name"}},
                              {"properties", state},
                              {"additionalProperties", false}},
                             0);
  recipe["states"]["description"] =
      "Variants of the object. What a state does not state is that of the recipe";
  return {
      {"$schema", "http://json-schema.org/draft-07/schema#"},
      {"title", "A recipe: what is shown, and how"},
      {"description", "Input of `slf build`, `slf raycast` and --states. Paths are relative to it"},
      {"type", "object"},
      {"properties", recipe},
      {"additionalProperties", false}};
}

std::string python_settings(std::span<const Option> options) {
  std::string out =
      "\"\"\"Options of recipes, as keyword arguments. Made from the table of the "
      "library.\"\"\"\n\n"
      "from __future__ import annotations\n\nfrom typing import Any, Sequence, TypedDict\n";
  add_class(out, "DataOptions", "How to read a source, and what is read beside it.", options,
            {Use::reading, Use::data, Use::cost, Use::truth});
  add_class(out, "ViewOptions", "Rays and light.", options, {Use::view});
  add_class(out, "FieldOptions", "The field to build.", options, {Use::frame, Use::field});
  return out;
}

}  // namespace slf::recipe
