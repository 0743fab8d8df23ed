#include "slf/remote.h"

#include "base/try.h"
#include "field/field_file.h"
#include "field/remote/remote_file.h"

namespace slf {

Result<RemoteField> RemoteField::open(const std::string& url, const RemoteOptions& options,
                                      const ProgressCallback& progress) try {
  auto source = SLF_TRY(RemoteFile::open(url, options, progress));
  auto store = SLF_TRY(storage::TileStore::open(source));
  auto file = SLF_TRY(FieldFile::open(store));
  return RemoteField(std::move(source), Field::of(std::move(file)));
} catch (...) {
  return tl::unexpected(error_of_exception());
}

RemoteTraffic RemoteField::traffic() const { return source_->traffic(); }

Result<Field> open_field(const std::string& place, const ProgressCallback& progress,
                         std::vector<RemoteField>* remote, const RemoteOptions& options) try {
  if (!is_address(place)) return Field::open(place);
  const auto opened = SLF_TRY(RemoteField::open(place, options, progress));
  if (remote) remote->push_back(opened);
  return opened.field();
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
