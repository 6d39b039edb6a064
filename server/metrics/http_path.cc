// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/http_path.h"

#include <tuple>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "server/base/memory_guard.h"

namespace sightline {

HttpPath::HttpPath(std::string name, Handler handler)
    : name_(std::move(name)), handler_(std::move(handler)) {
  for (int i = 0; i < kThreads; ++i) threads_.emplace_back([this] { Work(); });
}

HttpPath::~HttpPath() {
  {
    MutexLock lock(mutex_);
    stop_ = true;
    changed_.SignalAll();
  }
  for (std::thread& thread : threads_) thread.join();
}

bool HttpPath::Take(HttpRequest request, Done done) {
  MutexLock lock(mutex_);
  if (running_ + waiting_.size() >= kMostAtOnce) return false;
  waiting_.emplace_back(std::move(request), std::move(done));
  changed_.Signal();
  return true;
}

void HttpPath::Work() {
  while (true) {
    HttpRequest request;
    Done done;
    {
      MutexLock lock(mutex_);
      while (waiting_.empty() && !stop_) changed_.Wait(mutex_);
      if (stop_) return;
      std::tie(request, done) = std::move(waiting_.front());
      waiting_.pop_front();
      ++running_;
    }
    absl::StatusOr<HttpReply> reply =
        GuardMemory([&]() -> absl::StatusOr<HttpReply> { return handler_(request); });
    if (!reply.ok()) {
      reply = HttpReply{.code = 503, .body = absl::StrCat(reply.status().message(), "\n")};
    }
    {
      MutexLock lock(mutex_);
      --running_;
    }
    done(*std::move(reply));
  }
}

}  // namespace sightline
