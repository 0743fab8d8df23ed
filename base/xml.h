// XML through pugixml. Documents that declare entities are refused, so that text cannot expand.
#pragma once

#include <memory>
#include <pugixml.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"

namespace slf {

using XmlDocument = std::unique_ptr<pugi::xml_document>;

/// `source`: the name of the text for messages. bad_file: not well formed, or entities; the message
/// has the line.
[[nodiscard]] Result<XmlDocument> parse_xml(std::string_view text, const std::string& source);

/// All elements in a node, each before those in it.
[[nodiscard]] std::vector<pugi::xml_node> elements_of(pugi::xml_node node);

/// The name of an element, without its prefix.
[[nodiscard]] std::string_view name_of(const pugi::xml_node& element);

/// An attribute's value; empty if there is none.
[[nodiscard]] inline std::string attribute(const pugi::xml_node& element, const char* name) {
  return element.attribute(name).value();
}

}  // namespace slf
