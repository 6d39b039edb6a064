// SPDX-License-Identifier: Apache-2.0
//
// Which of the connections that were handed to gRPC are still open. gRPC owns their descriptors and
// tells nobody when it closes one, so the table remembers each by its descriptor and the inode of
// its socket, which no later socket shares, and looks.
//
// Invariant: a connection counts, in all and for its peer, from Add until gRPC has closed it.
//
// Thread safety: every method from any thread.
//
//   if (!table.AtLeast(limit)) { table.Add(fd, peer.Host()); Hand(fd); }
#ifndef SIGHTLINE_SERVER_NET_CONNECTION_TABLE_H_
#define SIGHTLINE_SERVER_NET_CONNECTION_TABLE_H_

#include <sys/types.h>

#include <cstddef>
#include <string>
#include <unordered_map>

#include "core/base/mutex.h"

namespace sightline {

class ConnectionTable {
 public:
  // An open socket, before it is handed over. `peer`: its address without the port; empty for one
  // without.
  void Add(int fd, const std::string& peer);
  // Looks at each: about 0.3 us.
  size_t CountOpen();
  // Whether so many are open; cheap while fewer were added since the last look.
  bool AtLeast(size_t count);
  // Whether so many of one peer's are; as cheap.
  bool AtLeastOf(const std::string& peer, size_t count);

 private:
  struct Connection {
    ino_t inode = 0;
    std::string peer;
  };
  size_t Sweep() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Uncount(const std::string& peer) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  Mutex mutex_;
  std::unordered_map<int, Connection> connections_ ABSL_GUARDED_BY(mutex_);  // By descriptor.
  std::unordered_map<std::string, size_t> peers_ ABSL_GUARDED_BY(mutex_);    // How many of each.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_NET_CONNECTION_TABLE_H_
