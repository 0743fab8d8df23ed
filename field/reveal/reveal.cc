#include "slf/reveal.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/guarded.h"
#include "base/try.h"
#include "codec/brick_volume.h"

namespace slf {
namespace {

constexpr std::uint32_t kMagic = 0x31564c53;                       // "SLV1"
constexpr std::uint32_t kLabels = 1, kMasked = 2, kLossShift = 8;  // flags
constexpr std::size_t kMaxText = 1024, kMaxIds = 256;

/// What a reveal has before its voxels, in order: File is Output or Input.
template <class File>
void code_head(File& file, Reveal& reveal, std::uint32_t& flags) {
  file.value(flags);
  for (std::uint32_t& side : reveal.dims) file.value(side);
  for (int k = 0; k < 3; ++k) file.value(reveal.origin[k]);
  for (int axis = 0; axis < 3; ++axis)
    for (int k = 0; k < 3; ++k) file.value(reveal.axes[axis][k]);
  for (double* number : {&reveal.low, &reveal.high, &reveal.greys[0], &reveal.greys[1],
                         &reveal.gradient, &reveal.unit})
    file.value(*number);
  file.list(reveal.ids, kMaxIds);
  file.list(reveal.part_ids, kMaxIds);
  file.list(reveal.content, kMaxText);
}

struct Output {
  Bytes bytes{};

  void value(std::uint32_t number) { append_le(bytes, number); }
  void value(double number) { append_le(bytes, std::bit_cast<std::uint64_t>(number)); }
  void value(char letter) { bytes.push_back(static_cast<std::byte>(letter)); }
  template <class List>
  void list(const List& values, std::size_t /*most*/) {
    value(static_cast<std::uint32_t>(values.size()));
    for (const auto one : values) value(one);
  }
};

/// After its end, numbers are 0.
struct Input {
  ByteSpan rest;
  bool damaged = false;

  template <class T>
  T take() {
    damaged = damaged || rest.size() < sizeof(T);
    if (damaged) return 0;
    const T number = load_le<T>(rest.data());
    rest = rest.subspan(sizeof(T));
    return number;
  }
  void value(std::uint32_t& number) { number = take<std::uint32_t>(); }
  void value(double& number) { number = std::bit_cast<double>(take<std::uint64_t>()); }
  void value(char& letter) { letter = static_cast<char>(take<std::uint8_t>()); }
  template <class List>
  void list(List& values, std::size_t most) {
    const auto count = take<std::uint32_t>();
    damaged = damaged || count > most;
    if (damaged) return;
    values.resize(count);
    for (auto& one : values) value(one);
  }
};

/// What contradicts in a head; null: nothing.
const char* fault_of(const Reveal& reveal, bool labels) {
  for (const std::uint32_t side : reveal.dims)
    if (side < 2 || side > Reveal::kMaxSide) return "its dims";
  double sum = std::abs(glm::determinant(reveal.axes));
  if (!(sum > 0)) return "its axes";
  for (int k = 0; k < 3; ++k) sum += glm::length(reveal.axes[k]) + std::abs(reveal.origin[k]);
  for (const double number :
       {reveal.low, reveal.high, reveal.greys[0], reveal.greys[1], reveal.gradient, reveal.unit})
    sum += std::abs(number);
  for (const auto* ids : {&reveal.ids, &reveal.part_ids})
    for (const double id : *ids) sum += std::abs(id);
  if (!std::isfinite(sum)) return "a number that is not finite";
  if (labels == reveal.ids.empty()) return "its ids";
  if (reveal.loss > (labels ? 0 : Reveal::kMaxLoss)) return "its loss";
  if (!(reveal.low < reveal.high && reveal.greys[0] < reveal.greys[1] && reveal.gradient > 0 &&
        reveal.unit > 0))
    return "its range of values";
  return nullptr;
}

/// Whether no byte is greater than `most`.
bool within(ByteSpan bytes, std::size_t most) {
  return std::ranges::all_of(bytes,
                             [&](std::byte b) { return std::to_integer<std::size_t>(b) <= most; });
}

/// What contradicts in its voxels; null: nothing.
const char* fault_of_voxels(const Reveal& reveal) {
  const std::size_t count = std::size_t{reveal.dims[0]} * reveal.dims[1] * reveal.dims[2];
  if (reveal.voxels.size() != count) return "the number of its voxels";
  if (!reveal.ids.empty() && !within(reveal.voxels, reveal.ids.size() - 1)) return "a label";
  if (reveal.parts.empty()) return nullptr;
  if (reveal.parts.size() != count) return "the number of its parts";
  return within(reveal.parts, reveal.part_ids.size() + (reveal.masked ? 1 : 0)) ? nullptr
                                                                                : "a structure";
}

}  // namespace

Result<std::vector<std::byte>> encode(const Reveal& reveal, unsigned threads) try {
  const char* fault = fault_of(reveal, !reveal.ids.empty());
  if (!fault) fault = fault_of_voxels(reveal);
  if (!fault && reveal.content.size() > kMaxText) fault = "its content";
  if (fault) return fail(ErrorCode::usage, "no reveal can have ", fault);
  Output out;
  Reveal head = reveal;
  head.voxels.clear(), head.parts.clear();
  std::uint32_t flags = (reveal.ids.empty() ? 0 : kLabels) | (reveal.masked ? kMasked : 0) |
                        reveal.loss << kLossShift;
  out.value(kMagic);
  code_head(out, head, flags);
  for (const auto* layer : {&reveal.voxels, &reveal.parts}) {
    Bytes coded;
    const int loss = layer == &reveal.voxels ? static_cast<int>(reveal.loss) : 0;
    if (!layer->empty()) coded = SLF_TRY(codec::encode_volume(reveal.dims, *layer, loss, threads));
    out.value(static_cast<std::uint32_t>(coded.size()));
    out.bytes.insert(out.bytes.end(), coded.begin(), coded.end());
  }
  return out.bytes;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<Reveal> decode_reveal(std::span<const std::byte> code, RevealPart part,
                             unsigned threads) try {
  const auto damaged = [](const char* what) {
    return fail(ErrorCode::bad_file, "its reveal is damaged: ", what);
  };
  Input in{code};
  const auto magic = in.take<std::uint32_t>();
  if (!in.damaged && magic != kMagic && (magic & 0xFFFFFF) == (kMagic & 0xFFFFFF))
    return fail(ErrorCode::unsupported, "its reveal is of a later version; update slf");
  if (magic != kMagic) return damaged("it is none");
  Reveal reveal;
  std::uint32_t flags = 0;
  code_head(in, reveal, flags);
  if (in.damaged) return damaged("its head");
  reveal.loss = flags >> kLossShift & 0xFF;
  if (const char* fault = fault_of(reveal, (flags & kLabels) != 0)) return damaged(fault);
  reveal.masked = (flags & kMasked) != 0;
  if (part == RevealPart::head) return reveal;
  for (auto* layer : {&reveal.voxels, &reveal.parts}) {
    const auto size = in.take<std::uint32_t>();
    if (in.damaged || size > in.rest.size()) return damaged("it ends too early");
    if (size > 0) {
      const int loss = layer == &reveal.voxels ? static_cast<int>(reveal.loss) : 0;
      auto voxels = codec::decode_volume(reveal.dims, in.rest.first(size), loss, threads);
      if (!voxels && voxels.error().code == ErrorCode::bad_file)
        return damaged(voxels.error().message.c_str());
      if (!voxels) return tl::unexpected(voxels.error());
      *layer = std::move(*voxels);
    }
    in.rest = in.rest.subspan(size);
  }
  if (!in.rest.empty()) return damaged("bytes follow it");
  if (const char* fault = fault_of_voxels(reveal)) return damaged(fault);
  return reveal;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

std::string content_of(std::string_view provenance) {
  const auto json = nlohmann::json::parse(provenance, nullptr, /*allow_exceptions=*/false);
  const auto text = [&](const char* pointer) {
    const nlohmann::json::json_pointer at(pointer);
    return json.contains(at) && json[at].is_string() ? json[at].get<std::string>() : std::string();
  };
  std::string content = text("/kind") == "volume" ? text("/content") : "";
  if (content.empty()) return content;
  return content + " " + text("/structures/labels") + " " + text("/structures/mask");
}

}  // namespace slf
