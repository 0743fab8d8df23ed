#include "base/xml.h"

#include <algorithm>
#include <new>

namespace slf {

Result<XmlDocument> parse_xml(std::string_view text, const std::string& source) {
  if (text.find("<!ENTITY") != std::string_view::npos)
    return bad_file(source, "it declares entities, which are not read");
  auto document = std::make_unique<pugi::xml_document>();
  const auto parsed = document->load_buffer(text.data(), text.size());
  if (parsed.status == pugi::status_out_of_memory) throw std::bad_alloc();
  if (parsed) return document;
  const auto before = text.substr(0, static_cast<std::size_t>(parsed.offset));
  return bad_file(source, "line ", 1 + std::ranges::count(before, '\n'), ": ",
                  parsed.description());
}

std::vector<pugi::xml_node> elements_of(pugi::xml_node node) {
  struct Walker : pugi::xml_tree_walker {
    std::vector<pugi::xml_node> found;
    bool for_each(pugi::xml_node& at) override {
      if (at.type() == pugi::node_element) found.push_back(at);
      return true;
    }
  } walker;
  node.traverse(walker);
  return std::move(walker.found);
}

std::string_view name_of(const pugi::xml_node& element) {
  const std::string_view name = element.name();
  return name.substr(name.rfind(':') + 1);  // all of it without a colon
}

}  // namespace slf
