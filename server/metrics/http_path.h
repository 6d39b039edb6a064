// SPDX-License-Identifier: Apache-2.0
//
// A path of the HTTP port: the function that answers it, on threads of the path's own, so that one
// that takes its time (a liveness check of a server that hangs) holds up no other.
//
// Invariant: at most kMostAtOnce requests run or wait; what was taken is answered once.
//
// Thread safety: Take from any thread, while End is called, too; `done` is called on the path's
// threads, or by Take or End where the path ends.
//
//   HttpPath path("/livez", [](const HttpRequest&) { return HttpReply{.body = "alive\n"}; });
//   if (!path.Take(request, [&](HttpReply reply) { Send(reply); })) Refuse();
#ifndef SIGHTLINE_SERVER_METRICS_HTTP_PATH_H_
#define SIGHTLINE_SERVER_METRICS_HTTP_PATH_H_

#include <cstddef>
#include <deque>
#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/functional/any_invocable.h"
#include "core/base/mutex.h"
#include "server/metrics/http_request.h"

namespace sightline {

class HttpPath {
 public:
  // A prober and a person at a time; what else comes waits a little, within its own patience.
  static constexpr int kThreads = 2;
  static constexpr size_t kMostAtOnce = 8;

  using Handler = std::function<HttpReply(const HttpRequest&)>;
  using Done = absl::AnyInvocable<void(HttpReply)>;

  HttpPath(std::string name, Handler handler);
  ~HttpPath();
  HttpPath(const HttpPath&) = delete;
  HttpPath& operator=(const HttpPath&) = delete;

  const std::string& name() const { return name_; }
  // False when as many run or wait as may. After End the answer is that the server ends.
  bool Take(HttpRequest request, Done done);
  // Answers what waits and what is still to come so, and returns when what runs is answered. The
  // destructor ends what has not been ended.
  void End();

 private:
  void Work();

  const std::string name_;
  const Handler handler_;
  Mutex mutex_;
  CondVar changed_;
  std::deque<std::pair<HttpRequest, Done>> waiting_ ABSL_GUARDED_BY(mutex_);
  size_t running_ ABSL_GUARDED_BY(mutex_) = 0;
  bool stop_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_METRICS_HTTP_PATH_H_
