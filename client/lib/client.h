// SPDX-License-Identifier: Apache-2.0
//
// A Sightline server, as a C++ value. Scenes are uploaded, listed and edited; camera tiles, shadows
// and segments are answered for whole images and arrays: the client cuts them into items, keeps
// within the server's flow control, spreads them over several streams, resumes what a draining or
// lost server left unanswered, and puts the answers together.
//
// Errors are the server's, with its machine-readable reason (GetErrorDetail in status.h). Calls
// that fail for a reason that may pass are repeated with back-off, as the Connection was told.
//
// One query sees one revision: the one asked for, or the one that was current when it started.
//
// Thread safety: a Client is a cheap handle; copies share the connection, and all members may be
// called from any thread. Callbacks of a query come from the library's threads, one call at a time.
//
//   Client client(MakeConnection("localhost:7070", {}));
//   absl::StatusOr<Scene> scene = client.CreateScene({.builtin = "builtin:hall"});
//   absl::StatusOr<TileImage> image = client.TraceImage({.scene = scene->name, .camera = camera,
//                                                        .outputs = {.depths = true}});
#ifndef SIGHTLINE_CLIENT_LIB_CLIENT_H_
#define SIGHTLINE_CLIENT_LIB_CLIENT_H_

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/lib/backoff.h"
#include "client/lib/cancellation.h"
#include "client/lib/connection.h"
#include "client/lib/types.h"

namespace sightline::client {

// How a streamed query goes about it; nothing here changes an answer.
struct StreamOptions {
  // How long the whole query may take.
  absl::Duration timeout = absl::InfiniteDuration();
  // When it ends at the latest, whatever is left of `timeout`: for several queries together.
  absl::Time deadline = absl::InfiniteFuture();
  // How long the server may take for one item; 0: as long as the query.
  absl::Duration item_timeout = absl::ZeroDuration();
  // Streams at once; 0: one per network connection.
  int streams = 0;
  // Ends the query early with CANCELLED; may be null. Must outlive the call.
  Cancellation* cancellation = nullptr;
  // How long to go on while the server cannot be reached or is busy. One that falls silent, pings
  // included, counts as lost within a minute; one that pings and answers no item is waited for.
  RetryOptions retry;
};

class Client {
 public:
  explicit Client(std::shared_ptr<Connection> connection);

  // ---- Scenes

  // Returns when the scene answers queries. Safe to repeat: carries a request id of its own.
  absl::StatusOr<Scene> CreateScene(const SceneSource& source,
                                    const CallOptions& options = {}) const;
  absl::StatusOr<Scene> GetScene(const std::string& name, const CallOptions& options = {}) const;
  absl::StatusOr<std::vector<Scene>> ListScenes(const CallOptions& options = {}) const;
  absl::StatusOr<std::vector<SceneObject>> ListSceneObjects(const std::string& name,
                                                            const CallOptions& options = {}) const;
  // A new revision with the edits applied in order, all or none. `base_revision` 0: whichever is.
  absl::StatusOr<Scene> UpdateScene(const std::string& name, const std::vector<SceneEdit>& edits,
                                    int64_t base_revision = 0,
                                    const CallOptions& options = {}) const;
  absl::Status DeleteScene(const std::string& name, const CallOptions& options = {}) const;
  // Reports the scene at once and at every change, until `on_change` returns false, the scene is
  // deleted (OK) or the call ends.
  absl::Status WatchScene(const std::string& name, bool wait_for_scene,
                          const std::function<bool(const SceneProgress&)>& on_change,
                          const CallOptions& options = {}) const;

  // ---- The server's repository

  // The scene as it is, if it is loaded already.
  absl::StatusOr<Scene> LoadScene(const std::string& name, const CallOptions& options = {}) const;
  // The next revision, of the scene's file; if that fails the one before goes on serving.
  absl::StatusOr<Scene> ReloadScene(const std::string& name, const CallOptions& options = {}) const;
  // Out of memory; the file stays.
  absl::Status UnloadScene(const std::string& name, const CallOptions& options = {}) const;
  absl::StatusOr<std::vector<StoredScene>> ListStoredScenes(const CallOptions& options = {}) const;

  // ---- Point sets

  absl::StatusOr<PointSet> CreatePointSet(const PointSetSource& source,
                                          const CallOptions& options = {}) const;
  absl::StatusOr<PointSet> GetPointSet(const std::string& name,
                                       const CallOptions& options = {}) const;
  absl::StatusOr<std::vector<PointSet>> ListPointSets(const std::string& scene,
                                                      const CallOptions& options = {}) const;
  absl::Status DeletePointSet(const std::string& name, const CallOptions& options = {}) const;
  absl::StatusOr<PointSet> RenewLease(const std::string& name, absl::Duration lease,
                                      const CallOptions& options = {}) const;

  // ---- Server

  // Asked once, and anew after a query or an upload that failed, or a query of which items had to
  // be sent again: the server may be another by then. While it runs the answer does not change.
  absl::StatusOr<Capabilities> GetCapabilities(const CallOptions& options = {}) const;
  // `service` empty: the server as a whole.
  absl::StatusOr<Health> CheckHealth(const std::string& service = "",
                                     const CallOptions& options = {}) const;

  // ---- Visibility

  // Calls `on_tile` once per tile, in the order in which answers come. An error from it ends the
  // query.
  absl::StatusOr<StreamSummary> TraceTiles(const TileQuery& query,
                                           const std::function<absl::Status(Tile)>& on_tile,
                                           const StreamOptions& options = {}) const;
  // The same, put together. `on_progress` (may be null) hears how many pixels are done.
  absl::StatusOr<TileImage> TraceImage(
      const TileQuery& query, const StreamOptions& options = {},
      const std::function<void(uint64_t done)>& on_progress = {}) const;

  // Calls `on_shadows` once per item, in the order in which answers come.
  absl::StatusOr<StreamSummary> ComputeShadows(
      const ShadowQuery& query, const std::function<absl::Status(Shadows)>& on_shadows,
      const StreamOptions& options = {}) const;
  // The same, put together for all points.
  absl::StatusOr<Shadows> ComputeAllShadows(
      const ShadowQuery& query, const StreamOptions& options = {},
      const std::function<void(uint64_t done)>& on_progress = {}) const;

  // Calls `on_segments` once per item, in the order in which answers come.
  absl::StatusOr<StreamSummary> TestSegments(
      const SegmentQuery& query, const std::function<absl::Status(Segments)>& on_segments,
      const StreamOptions& options = {}) const;
  // The same, put together for all segments.
  absl::StatusOr<Segments> TestAllSegments(
      const SegmentQuery& query, const StreamOptions& options = {},
      const std::function<void(uint64_t done)>& on_progress = {}) const;

 private:
  struct Shared;
  absl::StatusOr<int64_t> PinnedRevision(const std::string& scene, int64_t revision,
                                         const CallOptions& options) const;
  // The queries as they are run on one revision, the one that is current when they begin if theirs
  // is 0.
  absl::StatusOr<StreamSummary> RunTiles(const TileQuery& query, const StreamOptions& options,
                                         const std::function<absl::Status(Tile)>& on_tile) const;
  // `*points`, of which there are so many, is set before the first part comes.
  absl::StatusOr<StreamSummary> RunShadows(const ShadowQuery& query, const StreamOptions& options,
                                           const std::function<absl::Status(Shadows)>& on_shadows,
                                           uint64_t* points) const;
  absl::StatusOr<StreamSummary> RunShadowsOnce(
      const ShadowQuery& query, const StreamOptions& options,
      const std::function<absl::Status(Shadows)>& on_shadows, uint64_t* points) const;
  absl::StatusOr<StreamSummary> RunSegments(
      const SegmentQuery& asked, const StreamOptions& options,
      const std::function<absl::Status(Segments)>& on_segments) const;
  std::shared_ptr<Shared> shared_;
};

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_CLIENT_H_
