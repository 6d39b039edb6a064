// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/http_path.h"

#include <tuple>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "server/base/memory_guard.h"

namespace sightline {
namespace {

HttpReply TheServerEnds() { return {.code = 503, .body = "the server ends\n"}; }

}  // namespace

HttpPath::HttpPath(std::string name, Handler handler)
    : name_(std::move(name)), handler_(std::move(handler)) {
  for (int i = 0; i < kThreads; ++i) threads_.emplace_back([this] { Work(); });
}

HttpPath::~HttpPath() { End(); }

void HttpPath::End() {
  std::deque<std::pair<HttpRequest, Done>> dropped;
  {
    MutexLock lock(mutex_);
    stop_ = true;
    dropped.swap(waiting_);
    changed_.SignalAll();
  }
  for (auto& [request, done] : dropped) done(TheServerEnds());
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

bool HttpPath::Take(HttpRequest request, Done done) {
  {
    MutexLock lock(mutex_);
    if (!stop_) {
      if (running_ + waiting_.size() >= kMostAtOnce) return false;
      waiting_.emplace_back(std::move(request), std::move(done));
      changed_.Signal();
      return true;
    }
  }
  done(TheServerEnds());
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
