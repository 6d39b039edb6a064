// SPDX-License-Identifier: Apache-2.0
//
// Which of the connections that were handed to gRPC are still open. gRPC owns their descriptors and
// tells nobody when it closes one, so the table remembers each by its descriptor and the inode of
// its socket, which no later socket shares, and looks.
//
// Invariant: a connection counts from Add until gRPC has closed it.
//
// Thread safety: every method from any thread.
//
//   if (table.CountOpen() < limit) { table.Add(fd); Hand(fd); }
#ifndef SIGHTLINE_SERVER_NET_CONNECTION_TABLE_H_
#define SIGHTLINE_SERVER_NET_CONNECTION_TABLE_H_

#include <sys/types.h>

#include <cstddef>
#include <unordered_map>

#include "core/base/mutex.h"

namespace sightline {

class ConnectionTable {
 public:
  // An open socket, before it is handed over.
  void Add(int fd);
  // Looks at each: about 0.3 us.
  size_t CountOpen();
  // Whether so many are open; cheap while fewer were added since the last look.
  bool AtLeast(size_t count);

 private:
  size_t Sweep() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  Mutex mutex_;
  std::unordered_map<int, ino_t> inodes_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_NET_CONNECTION_TABLE_H_
