// SPDX-License-Identifier: Apache-2.0
#include "server/net/connection_table.h"

#include <sys/stat.h>

namespace sightline {

void ConnectionTable::Add(int fd, const std::string& peer) {
  struct stat file {};
  if (fstat(fd, &file) != 0) return;
  MutexLock lock(mutex_);
  // A descriptor's number comes again only once the connection of before is closed.
  Connection& connection = connections_[fd];
  if (connection.inode != 0) Uncount(connection.peer);
  connection = {file.st_ino, peer};
  ++peers_[peer];
}

void ConnectionTable::Uncount(const std::string& peer) {
  const auto found = peers_.find(peer);
  if (--found->second == 0) peers_.erase(found);
}

size_t ConnectionTable::CountOpen() {
  MutexLock lock(mutex_);
  return Sweep();
}

bool ConnectionTable::AtLeast(size_t count) {
  MutexLock lock(mutex_);
  return connections_.size() >= count && Sweep() >= count;
}

bool ConnectionTable::AtLeastOf(const std::string& peer, size_t count) {
  MutexLock lock(mutex_);
  const auto reached = [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const auto found = peers_.find(peer);
    return found != peers_.end() && found->second >= count;
  };
  if (!reached()) return false;
  Sweep();
  return reached();
}

size_t ConnectionTable::Sweep() {
  for (auto i = connections_.begin(); i != connections_.end();) {
    struct stat file {};
    const bool open =
        fstat(i->first, &file) == 0 && S_ISSOCK(file.st_mode) && file.st_ino == i->second.inode;
    if (open) {
      ++i;
      continue;
    }
    Uncount(i->second.peer);
    i = connections_.erase(i);
  }
  return connections_.size();
}

}  // namespace sightline
