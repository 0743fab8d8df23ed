#include "base/try.h"
#include "cli/command.h"
#include "slf/remote.h"

namespace slf::cli {

#ifdef SLF_REMOTE
namespace {

/// The remote fields that were opened, for their traffic.
std::vector<RemoteField> remote_fields;

}  // namespace

Result<Field> open_field(const std::string& path) {
  if (!is_address(path)) return Field::open(path);
  auto remote =
      SLF_TRY(RemoteField::open(path, {}, late_progress_bar("fetch", "bytes", OnSignal::end)));
  remote_fields.push_back(remote);
  return remote.field();
}

nlohmann::json traffic_json() {
  if (remote_fields.empty()) return {};
  RemoteTraffic sum;
  for (const RemoteField& field : remote_fields) {
    const RemoteTraffic traffic = field.traffic();
    sum.requests += traffic.requests;
    sum.repeated += traffic.repeated;
    sum.bytes += traffic.bytes;
  }
  return {{"requests", sum.requests}, {"repeated", sum.repeated}, {"bytes", sum.bytes}};
}
#else
Result<Field> open_field(const std::string& path) {
  if (!is_address(path)) return Field::open(path);
  return fail(ErrorCode::unsupported, path,
              ": this slf was built without libcurl and does not read fields over HTTP");
}

nlohmann::json traffic_json() { return {}; }
#endif

}  // namespace slf::cli
