// SPDX-License-Identifier: Apache-2.0
//
// A file system that fails where a test wants it to: each kind of call has a script of what its
// next calls do, and goes on as the real one when the script has run out.
//
// Thread safety: full. Faults set while calls are under way meet some of them.
//
//   FaultyFileCalls calls;
//   calls.write_error = ENOSPC;
//   calls.writes_before_fault = 3;
//   Folder::Open(dir.path(), calls);
#ifndef SIGHTLINE_TESTS_SUPPORT_FAULTY_FILE_CALLS_H_
#define SIGHTLINE_TESTS_SUPPORT_FAULTY_FILE_CALLS_H_

#include <sys/mman.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <functional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "core/base/file_calls.h"
#include "core/base/mutex.h"

namespace sightline::testing_support {

// Something of the test's to call, if there is anything. Thread safety: full.
class FileCallHook {
 public:
  FileCallHook& operator=(std::function<void()> call) {
    const MutexLock lock(mutex_);
    call_ = std::move(call);
    return *this;
  }
  void operator()() {
    std::function<void()> call;
    {
      const MutexLock lock(mutex_);
      call = call_;
    }
    if (call) call();
  }

 private:
  Mutex mutex_;
  std::function<void()> call_ ABSL_GUARDED_BY(mutex_);
};

class FaultyFileCalls final : public FileCalls {
 public:
  // errno values; 0: no fault.
  std::atomic<int> open_error{0}, write_error{0}, sync_error{0}, rename_error{0}, unlink_error{0},
      map_error{0}, read_error{0}, stat_error{0}, access_error{0}, mode_error{0};
  // Calls that still succeed before the fault sets in.
  std::atomic<int> writes_before_fault{0}, syncs_before_fault{0}, reads_before_fault{0};
  // The most bytes that a write takes; 0: as many as it likes.
  std::atomic<size_t> short_write{0};
  std::atomic<size_t> short_read{0};  // The most that a read gives.
  // Writes that are interrupted before one goes through.
  std::atomic<int> interrupts{0};
  // Called at the beginning of every Map, every UnlinkAt and every Write.
  FileCallHook on_map, on_unlink, on_write;
  FileCallHook on_stat;  // Called at the end of every StatAt, which knows its answer by then.

  int OpenAt(int folder, const char* name, int flags, mode_t mode) override {
    if (open_error != 0) return Fail(open_error);
    return FileCalls::OpenAt(folder, name, flags, mode);
  }
  ssize_t Write(int file, const void* data, size_t bytes) override {
    on_write();
    if (interrupts > 0) {
      --interrupts;
      return Fail(EINTR);
    }
    if (write_error != 0 && writes_before_fault-- <= 0) return Fail(write_error);
    if (short_write != 0) bytes = std::min<size_t>(bytes, short_write);
    return FileCalls::Write(file, data, bytes);
  }
  ssize_t ReadAt(int file, void* data, size_t bytes, off_t offset) override {
    if (interrupts > 0) {
      --interrupts;
      return Fail(EINTR);
    }
    if (read_error != 0 && reads_before_fault-- <= 0) return Fail(read_error);
    if (short_read != 0) bytes = std::min<size_t>(bytes, short_read);
    return FileCalls::ReadAt(file, data, bytes, offset);
  }
  int Sync(int file) override {
    if (sync_error != 0 && syncs_before_fault-- <= 0) return Fail(sync_error);
    return FileCalls::Sync(file);
  }
  int StatAt(int folder, const char* name, struct stat* status) override {
    if (stat_error != 0) return Fail(stat_error);
    const int result = FileCalls::StatAt(folder, name, status);
    const int error = errno;
    on_stat();
    errno = error;
    return result;
  }
  int ChangeMode(int file, mode_t mode) override {
    if (mode_error != 0) return Fail(mode_error);
    return FileCalls::ChangeMode(file, mode);
  }
  int AccessAt(int folder, const char* name, int mode) override {
    if (access_error != 0) return Fail(access_error);
    return FileCalls::AccessAt(folder, name, mode);
  }
  int RenameAt(int folder, const char* from, const char* to) override {
    if (rename_error != 0) return Fail(rename_error);
    return FileCalls::RenameAt(folder, from, to);
  }
  int UnlinkAt(int folder, const char* name) override {
    on_unlink();
    if (unlink_error != 0) return Fail(unlink_error);
    return FileCalls::UnlinkAt(folder, name);
  }
  void* Map(int file, size_t bytes) override {
    on_map();
    if (map_error != 0) {
      errno = map_error;
      return MAP_FAILED;
    }
    return FileCalls::Map(file, bytes);
  }

 private:
  static int Fail(int error) {
    errno = error;
    return -1;
  }
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_FAULTY_FILE_CALLS_H_
