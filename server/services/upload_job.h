// SPDX-License-Identifier: Apache-2.0
//
// What the three client-streamed creations have in common: the header is checked as soon as it is
// there, what is announced and what arrives are held against the memory budget as they come, and a
// call whose request_id has been served before is answered at once with what the first one made.
//
// Invariant: what has arrived counts against Steps' budget until the job is gone.
//
// Thread safety: one thread at a time.
//
//   return StartUpload<CreateSteps>(*context, response, env_, slots_);
#ifndef SIGHTLINE_SERVER_SERVICES_UPLOAD_JOB_H_
#define SIGHTLINE_SERVER_SERVICES_UPLOAD_JOB_H_

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/base/status_macros.h"
#include "server/admission/client_name.h"
#include "server/admission/memory_charge.h"
#include "server/admission/upload_slots.h"
#include "server/base/request_log.h"
#include "server/services/upload_reactor.h"
#include "server/stream/query_environment.h"

namespace sightline {

// A Job of UploadReactor. Steps is made from a QueryEnvironment and a Client and must have:
//   using Request, Response;
//   static constexpr Operation kOperation;
//   using Upload, Header;         // Such as SceneUpload and SceneHeader.
//   RequestLog& requests() const;
//   static MemoryBudget& BudgetOf(const QueryEnvironment&);
//   absl::Status CheckHeader(const Header&);  // Of a new request; told before the upload.
//   absl::Status CheckAnnounced(const Upload&) const;  // After each message but the header.
//   // Everything has arrived. See UploadReactor's Job.
//   absl::StatusOr<WorkElsewhere> Prepare(Upload&, const CancelToken&);
//   // Makes what the upload describes, fills the response, and returns the resource's name.
//   absl::StatusOr<std::string> Make(Upload&, const CancelToken&, Response*);
//   absl::Status Find(const std::string& resource, Response*) const;  // Made by an earlier call.
template <typename Steps>
class UploadJob {
 public:
  using Request = typename Steps::Request;
  using Response = typename Steps::Response;
  static constexpr Operation kOperation = Steps::kOperation;

  UploadJob(const QueryEnvironment& env, const Client& client)
      : steps_(env, client), charge_(Steps::BudgetOf(env)), upload_(env.limits) {}

  static uint64_t BytesOf(const Request& message) { return Steps::Upload::BytesOf(message); }

  absl::Status Add(const Request& message) {
    SL_RETURN_IF_ERROR(charge_.Add(BytesOf(message)));
    const bool first = !upload_.header().has_value();
    SL_RETURN_IF_ERROR(upload_.Add(message));
    if (!first) return steps_.CheckAnnounced(upload_);
    const typename Steps::Header& header = *upload_.header();
    SL_ASSIGN_OR_RETURN(claim_, steps_.requests().Claim(header.request_id, header.fingerprint));
    return claim_.repeated() ? absl::OkStatus() : steps_.CheckHeader(header);
  }

  bool answered() const { return claim_.repeated(); }

  absl::StatusOr<WorkElsewhere> Prepare(const CancelToken& cancel) {
    if (claim_.repeated()) return WorkElsewhere();
    return steps_.Prepare(upload_, cancel);
  }

  absl::Status Finish(const CancelToken& cancel, Response* response) {
    if (claim_.repeated()) return steps_.Find(claim_.resource(), response);
    SL_ASSIGN_OR_RETURN(const std::string name, steps_.Make(upload_, cancel, response));
    claim_.Complete(name);
    return absl::OkStatus();
  }

 private:
  Steps steps_;
  MemoryCharge charge_;  // Given back once `upload_` is gone.
  typename Steps::Upload upload_;
  RequestClaim claim_;
};

// The reactor for a new call. It deletes itself.
template <typename Steps>
UploadReactor<UploadJob<Steps>>* StartUpload(const grpc::CallbackServerContext& context,
                                             grpc::ByteBuffer* response,
                                             const QueryEnvironment& env, UploadSlots& slots) {
  return UploadReactor<UploadJob<Steps>>::Start(context, response, env, slots);
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVICES_UPLOAD_JOB_H_
