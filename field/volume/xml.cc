#include "field/volume/xml.h"

#include <expat.h>

#include <exception>
#include <memory>
#include <new>
#include <vector>

#include "base/try.h"
#include "field/volume/io.h"

namespace slf::volume_io {

namespace {

std::string_view without_prefix(const char* name) {
  const std::string_view text = name;
  const auto colon = text.rfind(':');
  return colon == std::string_view::npos ? text : text.substr(colon + 1);
}

class Parser {
 public:
  Parser(const std::string& source, const XmlHandler& handler)
      : source_(source), handler_(handler), parser_(XML_ParserCreate(nullptr)) {
    if (!parser_) throw std::bad_alloc();
    XML_SetUserData(parser_.get(), this);
    XML_SetElementHandler(parser_.get(), &Parser::on_start, &Parser::on_end);
    XML_SetCharacterDataHandler(parser_.get(), &Parser::on_text);
    XML_SetEntityDeclHandler(parser_.get(), &Parser::on_entity);
  }

  /// Returns whether parsing should go on.
  Result<bool> feed(std::string_view bytes, bool last) {
    const auto status =
        XML_Parse(parser_.get(), bytes.data(), static_cast<int>(bytes.size()), last ? 1 : 0);
    if (failure_) std::rethrow_exception(failure_);
    if (ended_) return false;
    if (status == XML_STATUS_OK) return true;
    return fail(ErrorCode::bad_file, source_, ": line ", XML_GetCurrentLineNumber(parser_.get()),
                ": ", refused_ ? refused_ : XML_ErrorString(XML_GetErrorCode(parser_.get())));
  }
  [[nodiscard]] std::uint64_t end_of_element() const { return end_; }

 private:
  // No exception may pass through expat, which is C.
  template <class Body>
  void guarded(const Body& body) {
    if (failure_ || ended_ || refused_) return;
    try {
      body();
    } catch (...) {
      failure_ = std::current_exception();
      XML_StopParser(parser_.get(), XML_FALSE);
    }
  }
  void refuse(const char* why) {
    refused_ = why;
    XML_StopParser(parser_.get(), XML_FALSE);
  }
  static Parser& self(void* user) { return *static_cast<Parser*>(user); }

  static void on_start(void* user, const XML_Char* name, const XML_Char** attributes) {
    Parser& p = self(user);
    p.guarded([&] {
      if (++p.depth_ > kMaxXmlDepth) return p.refuse("elements are nested too deeply");
      XmlAttributes all;
      for (; *attributes; attributes += 2)
        all[std::string(without_prefix(attributes[0]))] = attributes[1];
      if (p.handler_.start(without_prefix(name), all)) return;
      p.ended_ = true;
      p.end_ = static_cast<std::uint64_t>(XML_GetCurrentByteIndex(p.parser_.get())) +
               static_cast<std::uint64_t>(XML_GetCurrentByteCount(p.parser_.get()));
      XML_StopParser(p.parser_.get(), XML_FALSE);
    });
  }
  static void on_end(void* user, const XML_Char* name) {
    Parser& p = self(user);
    p.guarded([&] {
      --p.depth_;
      p.handler_.end(without_prefix(name));
    });
  }
  static void on_text(void* user, const XML_Char* text, int length) {
    Parser& p = self(user);
    p.guarded([&] { p.handler_.text({text, static_cast<std::size_t>(length)}); });
  }
  static void on_entity(void* user, const XML_Char*, int, const XML_Char*, int, const XML_Char*,
                        const XML_Char*, const XML_Char*, const XML_Char*) {
    self(user).refuse("it declares entities, which are not read");
  }

  struct Free {
    void operator()(XML_ParserStruct* parser) const { XML_ParserFree(parser); }
  };

  const std::string& source_;
  const XmlHandler& handler_;
  std::unique_ptr<XML_ParserStruct, Free> parser_;
  int depth_ = 0;
  bool ended_ = false;
  std::uint64_t end_ = 0;
  const char* refused_ = nullptr;
  std::exception_ptr failure_;
};

}  // namespace

Result<std::uint64_t> read_xml(const std::string& path, const XmlHandler& handler) {
  auto reader = SLF_TRY(ByteReader::open(path, 0, false));
  Parser parser(path, handler);
  std::vector<char> chunk(std::size_t{1} << 16);
  std::uint64_t bytes = 0;
  while (true) {
    const auto got = SLF_TRY(reader.read(std::as_writable_bytes(std::span(chunk))));
    const auto more = SLF_TRY(parser.feed({chunk.data(), got}, got == 0));
    if (!more) return parser.end_of_element();
    bytes += got;
    if (got == 0) return bytes;
  }
}

Result<std::uint64_t> parse_xml(std::string_view text, const std::string& source,
                                const XmlHandler& handler) {
  Parser parser(source, handler);
  constexpr std::size_t kMaxBytes = std::size_t{1} << 30;
  const auto more = SLF_TRY(parser.feed(text.substr(0, kMaxBytes), true));
  return more ? text.size() : parser.end_of_element();
}

}  // namespace slf::volume_io
