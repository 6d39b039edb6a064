// SPDX-License-Identifier: Apache-2.0
#include "server/services/point_set_service.h"

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "server/admission/memory_charge.h"
#include "server/base/error.h"
#include "server/base/log.h"
#include "server/base/request_log.h"
#include "server/base/resource_name.h"
#include "server/codec/scene_codec.h"
#include "server/points/camera_points.h"
#include "server/points/camera_trace.h"
#include "server/points/point_upload.h"
#include "server/services/unary.h"
#include "server/services/upload_job.h"

namespace sightline {
namespace {

void EncodePointSet(const PointSetView& view, v1::PointSet* out) {
  const PointSet& set = *view.set;
  out->set_name(set.name());
  out->set_revision(static_cast<int64_t>(set.revision));
  out->set_point_count(set.points.size());
  out->set_invalid_point_count(set.points.invalid);
  out->set_attached_point_count(set.points.attached);
  out->set_near_surface_point_count(set.points.near_surface);
  EncodeTime(set.create_time, out->mutable_create_time());
  EncodeTime(view.expire_time, out->mutable_expire_time());
  out->set_resident_bytes(set.MemoryBytes());
}

absl::Status FindPointSet(const QueryEnvironment& env, const std::string& name,
                          v1::PointSet* response) {
  SL_ASSIGN_OR_RETURN(const PointSetName parsed, ParsePointSetName("name", name));
  SL_ASSIGN_OR_RETURN(const PointSetView view,
                      env.point_sets.Get(parsed.scene_id, parsed.point_set_id));
  EncodePointSet(view, response);
  return absl::OkStatus();
}

// See upload_job.h.
class CreatePointSetSteps {
 public:
  using Request = v1::CreatePointSetRequest;
  static constexpr Operation kOperation = Operation::kCreatePointSet;
  using Response = v1::PointSet;
  using Upload = PointUpload;
  using Header = PointSetHeader;

  CreatePointSetSteps(const QueryEnvironment& env, const Client& client)
      : env_(env), client_(client), charge_(env.point_sets) {}

  RequestLog& requests() const { return env_.point_sets.requests(); }
  static MemoryBudget& BudgetOf(const QueryEnvironment& env) { return env.point_sets; }
  // The header has announced everything.
  static absl::Status CheckAnnounced(const Upload&) { return absl::OkStatus(); }

  absl::Status CheckHeader(const Header& header) {
    SL_ASSIGN_OR_RETURN(const std::shared_ptr<const Scene> scene,
                        env_.scenes.PinTagged(header.scene_id, header.revision, &set_.scene_tag));
    // An edit during the upload makes the sources wrong, and so does another scene of the name:
    // told at the end.
    revision_ = scene->revision;
    const uint64_t arriving = header.camera.has_value() ? 0 : header.point_count * sizeof(Vec3d);
    return env_.point_sets.CheckRoom(header.scene_id, header.point_set_id, header.point_count,
                                     arriving);
  }

  // A camera's points are traced by turns with everybody's queries.
  absl::StatusOr<WorkElsewhere> Prepare(Upload& upload, const CancelToken& cancel) {
    SL_ASSIGN_OR_RETURN(uploaded_, upload.Finish());
    const PointSetHeader& header = *upload.header();
    SL_ASSIGN_OR_RETURN(scene_, env_.scenes.PinOf(header.scene_id, revision_, set_.scene_tag));
    set_.scene_id = header.scene_id;
    set_.point_set_id = header.point_set_id.empty() ? MakeId("points") : header.point_set_id;
    set_.revision = scene_->revision;
    set_.scene = scene_;
    // Before anything is traced: several of these may be under way.
    SL_RETURN_IF_ERROR(charge_.Add(PointSetStore::BytesFor(header.point_count)));
    if (!header.camera.has_value()) return WorkElsewhere();
    SL_ASSIGN_OR_RETURN(std::unique_ptr<CameraPoints> points,
                        CameraPoints::Make(scene_, *header.camera, header.camera_options));
    SL_ASSIGN_OR_RETURN(trace_, CameraTrace::Admit(env_.scheduler, env_.ray_queue, client_,
                                                   std::move(points), &cancel));
    // The last task takes the trace's lock before it resumes: not before Start has let go of it.
    return [this](CameraTrace::Done resume) { trace_->Start(std::move(resume)); };
  }

  absl::StatusOr<std::string> Make(Upload& upload, const CancelToken& cancel, Response* response) {
    const PointSetHeader& header = *upload.header();
    SL_ASSIGN_OR_RETURN(set_.points, MakePoints(header, cancel));
    // Once for all lights that are going to be asked about. Speed alone: not where it is too much.
    // By the pool that this runs in: no query waits for it.
    if (charge_.Add(PointOrders::BytesFor(set_.points.size(), env_.build_pool.threads())).ok()) {
      set_.orders = PointOrders(set_.points.positions, set_.points.valid, env_.build_pool, &cancel);
      if (cancel.cancelled()) return cancel.ToStatus();
    }
    SL_ASSIGN_OR_RETURN(const PointSetView view,
                        env_.point_sets.Add(std::move(set_), header.lease, charge_.Leave()));
    // One that is deleted from here on takes the set with it.
    const PointSet& set = *view.set;
    if (absl::Status there = env_.scenes.CheckTag(set.scene_id, set.revision, set.scene_tag);
        !there.ok()) {
      env_.point_sets.RemoveScene(set.scene_id, set.scene_tag);
      return there;
    }
    Log(LogLevel::kInfo, "point_set_created",
        {{"point_set", view.set->name()}, {"points", absl::StrCat(view.set->points.size())}});
    EncodePointSet(view, response);
    return view.set->name();
  }

  absl::Status Find(const std::string& resource, Response* response) const {
    return FindPointSet(env_, resource, response);
  }

 private:
  absl::StatusOr<PreparedPoints> MakePoints(const PointSetHeader& header,
                                            const CancelToken& cancel) const {
    if (trace_ != nullptr) return trace_->Take();
    SL_ASSIGN_OR_RETURN(const std::vector<uint32_t> sources, uploaded_.Sources(scene_->geometry));
    return PreparePoints(*scene_, {uploaded_.positions, uploaded_.normals, sources}, header.options,
                         &cancel);
  }

  const QueryEnvironment env_;
  const Client client_;
  uint64_t revision_ = 0;
  // From Prepare to Make.
  MemoryCharge charge_;
  std::shared_ptr<const Scene> scene_;
  DecodedPoints uploaded_;
  std::shared_ptr<CameraTrace> trace_;  // Null for points that were uploaded.
  PointSet set_;
};

}  // namespace

grpc::ServerReadReactor<grpc::ByteBuffer>* PointSetService::CreatePointSet(
    grpc::CallbackServerContext* context, grpc::ByteBuffer* response) {
  return StartUpload<CreatePointSetSteps>(*context, response, env_, slots_);
}

grpc::ServerUnaryReactor* PointSetService::GetPointSet(grpc::CallbackServerContext*,
                                                       const v1::GetPointSetRequest* request,
                                                       v1::PointSet* response) {
  return Answer(env_, Operation::kGetPointSet,
                [&] { return FindPointSet(env_, request->name(), response); });
}

grpc::ServerUnaryReactor* PointSetService::ListPointSets(grpc::CallbackServerContext*,
                                                         const v1::ListPointSetsRequest* request,
                                                         v1::ListPointSetsResponse* response) {
  return Answer(env_, Operation::kListPointSets, [&]() -> absl::Status {
    SL_ASSIGN_OR_RETURN(const std::string scene_id, ParseSceneName("parent", request->parent()));
    SL_ASSIGN_OR_RETURN(const Page page, ParsePage(request->page_size(), request->page_token()));
    SL_RETURN_IF_ERROR(env_.scenes.Get(scene_id).status());
    std::vector<PointSetView> views = env_.point_sets.List(scene_id, page.after, page.size + 1);
    if (CutToPage(page, &views)) {
      response->set_next_page_token(PageToken(views.back().set->point_set_id));
    }
    for (const PointSetView& view : views) EncodePointSet(view, response->add_point_sets());
    return absl::OkStatus();
  });
}

grpc::ServerUnaryReactor* PointSetService::DeletePointSet(grpc::CallbackServerContext* context,
                                                          const v1::DeletePointSetRequest* request,
                                                          google::protobuf::Empty*) {
  return AnswerLater(*context, env_, env_.call_pool, Operation::kDeletePointSet,
                     [this, request](const CancelToken&) -> absl::Status {
                       SL_ASSIGN_OR_RETURN(const PointSetName name,
                                           ParsePointSetName("name", request->name()));
                       return env_.point_sets.Remove(name.scene_id, name.point_set_id);
                     });
}

grpc::ServerUnaryReactor* PointSetService::RenewLease(grpc::CallbackServerContext*,
                                                      const v1::RenewLeaseRequest* request,
                                                      v1::PointSet* response) {
  return Answer(env_, Operation::kRenewLease, [&]() -> absl::Status {
    SL_ASSIGN_OR_RETURN(const PointSetName name, ParsePointSetName("name", request->name()));
    SL_ASSIGN_OR_RETURN(
        const absl::Duration lease,
        DecodeDuration("lease_duration", request->has_lease_duration(), request->lease_duration(),
                       kDefaultLease, absl::Seconds(env_.limits.max_lease_seconds)));
    SL_ASSIGN_OR_RETURN(const PointSetView view,
                        env_.point_sets.Renew(name.scene_id, name.point_set_id, lease));
    EncodePointSet(view, response);
    return absl::OkStatus();
  });
}

}  // namespace sightline
