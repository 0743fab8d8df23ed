// SQLite: one table with the key as rowid; pages read through its cache, or from a map.
#include <sqlite3.h>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/store_peer.h"

namespace slf::bench {
namespace {

struct Close {
  void operator()(sqlite3* database) const { sqlite3_close(database); }
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};
using Database = std::unique_ptr<sqlite3, Close>;
using Statement = std::unique_ptr<sqlite3_stmt, Close>;

Database open_database(const std::string& path, int flags) {
  sqlite3* database = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &database, flags | SQLITE_OPEN_NOMUTEX, nullptr);
  Database opened(database);
  require(code == SQLITE_OK, path + ": " + sqlite3_errmsg(database));
  return opened;
}

void execute(sqlite3* database, const char* sql) {
  require(sqlite3_exec(database, sql, nullptr, nullptr, nullptr) == SQLITE_OK,
          std::string(sql) + ": " + sqlite3_errmsg(database));
}

Statement prepare(sqlite3* database, const char* sql) {
  sqlite3_stmt* statement = nullptr;
  require(sqlite3_prepare_v2(database, sql, -1, &statement, nullptr) == SQLITE_OK,
          std::string(sql) + ": " + sqlite3_errmsg(database));
  return Statement(statement);
}

// Each thread has a connection of its own, as SQLite advises.
class SqliteReader final : public StoreReader {
 public:
  SqliteReader(const TileSet& set, const std::string& path, bool mapped)
      : StoreReader(set), database_(open_database(path, SQLITE_OPEN_READONLY)) {
    execute(database_.get(), mapped ? "PRAGMA mmap_size=1099511627776" : "PRAGMA mmap_size=0");
    execute(database_.get(), "PRAGMA cache_size=-262144");
    execute(database_.get(), "BEGIN");  // otherwise every statement locks the file again
    get_ = prepare(database_.get(), "SELECT payload FROM tiles WHERE key=?");
  }

  ByteSpan get(std::size_t tile) override {
    sqlite3_reset(get_.get());
    sqlite3_bind_int64(get_.get(), 1, static_cast<sqlite3_int64>(set().keys[tile]));
    require(sqlite3_step(get_.get()) == SQLITE_ROW, "SQLite: no such tile");
    const auto* bytes = static_cast<const std::byte*>(sqlite3_column_blob(get_.get(), 0));
    return {bytes, static_cast<std::size_t>(sqlite3_column_bytes(get_.get(), 0))};
  }

 private:
  Database database_;
  Statement get_;
};

class SqliteStore final : public OpenStore {
 public:
  SqliteStore(const TileSet& set, std::string path, bool mapped)
      : set_(set), path_(std::move(path)), mapped_(mapped) {
    (void)reader();  // pays the cost of opening in advance
  }
  std::unique_ptr<StoreReader> reader() const override {
    return std::make_unique<SqliteReader>(set_, path_, mapped_);
  }

 private:
  const TileSet& set_;
  std::string path_;
  bool mapped_;
};

class Sqlite final : public StorePeer {
 public:
  explicit Sqlite(bool mapped) : mapped_(mapped) {}
  std::string name() const override { return mapped_ ? "SQLite, mmap" : "SQLite"; }

  void write(const TileSet& set, const std::string& path) const override {
    const Database database = open_database(path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
    execute(database.get(), "PRAGMA journal_mode=OFF");
    execute(database.get(), "CREATE TABLE tiles(key INTEGER PRIMARY KEY, payload BLOB)");
    execute(database.get(), "BEGIN");
    const Statement put = prepare(database.get(), "INSERT INTO tiles VALUES(?,?)");
    for (std::size_t i = 0; i < set.size(); ++i) {
      sqlite3_reset(put.get());
      sqlite3_bind_int64(put.get(), 1, static_cast<sqlite3_int64>(set.keys[i]));
      sqlite3_bind_blob64(put.get(), 2, set.payloads[i].data(), set.payloads[i].size(),
                          SQLITE_STATIC);
      require(sqlite3_step(put.get()) == SQLITE_DONE, "SQLite: cannot insert");
    }
    execute(database.get(), "COMMIT");
  }

  std::unique_ptr<OpenStore> open(const TileSet& set, const std::string& path) const override {
    return std::make_unique<SqliteStore>(set, path, mapped_);
  }

 private:
  bool mapped_;
};

}  // namespace

std::unique_ptr<StorePeer> make_sqlite(bool mapped) { return std::make_unique<Sqlite>(mapped); }

}  // namespace slf::bench
