// SPDX-License-Identifier: Apache-2.0
//
// A Connection for tests of what stands above it.
//
// Thread safety: as gmock has it.
#ifndef SIGHTLINE_TESTS_CLIENT_LIB_MOCK_CONNECTION_H_
#define SIGHTLINE_TESTS_CLIENT_LIB_MOCK_CONNECTION_H_

#include <memory>
#include <string>

#include "client/lib/connection.h"
#include "gmock/gmock.h"

namespace sightline::client {

class MockConnection : public Connection {
 public:
  MOCK_METHOD(absl::StatusOr<v1::Scene>, CreateScene,
              (const Upload<v1::CreateSceneRequest>&, const CallOptions&), (override));
  MOCK_METHOD(absl::StatusOr<v1::Scene>, UpdateScene,
              (const Upload<v1::UpdateSceneRequest>&, const CallOptions&), (override));
  MOCK_METHOD(absl::StatusOr<v1::Scene>, GetScene, (const v1::GetSceneRequest&, const CallOptions&),
              (override));
  MOCK_METHOD(absl::StatusOr<v1::ListScenesResponse>, ListScenes,
              (const v1::ListScenesRequest&, const CallOptions&), (override));
  MOCK_METHOD(absl::StatusOr<v1::ListSceneObjectsResponse>, ListSceneObjects,
              (const v1::ListSceneObjectsRequest&, const CallOptions&), (override));
  MOCK_METHOD(absl::Status, DeleteScene, (const v1::DeleteSceneRequest&, const CallOptions&),
              (override));
  MOCK_METHOD(absl::Status, WatchScene,
              (const v1::WatchSceneRequest&,
               const std::function<bool(const v1::WatchSceneResponse&)>&, const CallOptions&),
              (override));
  MOCK_METHOD(absl::StatusOr<v1::Scene>, LoadScene,
              (const v1::LoadSceneRequest&, const CallOptions&), (override));
  MOCK_METHOD(absl::StatusOr<v1::Scene>, ReloadScene,
              (const v1::ReloadSceneRequest&, const CallOptions&), (override));
  MOCK_METHOD(absl::Status, UnloadScene, (const v1::UnloadSceneRequest&, const CallOptions&),
              (override));
  MOCK_METHOD(absl::StatusOr<v1::ListStoredScenesResponse>, ListStoredScenes,
              (const v1::ListStoredScenesRequest&, const CallOptions&), (override));
  MOCK_METHOD(absl::StatusOr<v1::PointSet>, CreatePointSet,
              (const Upload<v1::CreatePointSetRequest>&, const CallOptions&), (override));
  MOCK_METHOD(absl::StatusOr<v1::PointSet>, GetPointSet,
              (const v1::GetPointSetRequest&, const CallOptions&), (override));
  MOCK_METHOD(absl::StatusOr<v1::ListPointSetsResponse>, ListPointSets,
              (const v1::ListPointSetsRequest&, const CallOptions&), (override));
  MOCK_METHOD(absl::Status, DeletePointSet, (const v1::DeletePointSetRequest&, const CallOptions&),
              (override));
  MOCK_METHOD(absl::StatusOr<v1::PointSet>, RenewLease,
              (const v1::RenewLeaseRequest&, const CallOptions&), (override));
  MOCK_METHOD(absl::StatusOr<v1::Capabilities>, GetCapabilities, (const CallOptions&), (override));
  MOCK_METHOD(absl::StatusOr<Health>, CheckHealth, (const std::string&, const CallOptions&),
              (override));
  MOCK_METHOD(int, channel_count, (), (const, override));
  MOCK_METHOD(std::unique_ptr<TileStream>, OpenTiles, (int, const CallOptions&), (override));
  MOCK_METHOD(std::unique_ptr<ShadowStream>, OpenShadows, (int, const CallOptions&), (override));
  MOCK_METHOD(std::unique_ptr<SegmentStream>, OpenSegments, (int, const CallOptions&), (override));
};

}  // namespace sightline::client

#endif  // SIGHTLINE_TESTS_CLIENT_LIB_MOCK_CONNECTION_H_
