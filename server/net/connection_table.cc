// SPDX-License-Identifier: Apache-2.0
#include "server/net/connection_table.h"

#include <sys/stat.h>

namespace sightline {

void ConnectionTable::Add(int fd) {
  struct stat file {};
  if (fstat(fd, &file) != 0) return;
  MutexLock lock(mutex_);
  // A descriptor's number comes again only once the connection of before is closed.
  inodes_[fd] = file.st_ino;
}

size_t ConnectionTable::CountOpen() {
  MutexLock lock(mutex_);
  return Sweep();
}

bool ConnectionTable::AtLeast(size_t count) {
  MutexLock lock(mutex_);
  return inodes_.size() >= count && Sweep() >= count;
}

size_t ConnectionTable::Sweep() {
  std::erase_if(inodes_, [](const auto& entry) {
    struct stat file {};
    return fstat(entry.first, &file) != 0 || !S_ISSOCK(file.st_mode) || file.st_ino != entry.second;
  });
  return inodes_.size();
}

}  // namespace sightline
