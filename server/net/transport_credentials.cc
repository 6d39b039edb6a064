// SPDX-License-Identifier: Apache-2.0
#include "server/net/transport_credentials.h"

#include <grpc/grpc.h>
#include <grpc/grpc_security_constants.h>
#include <grpc/slice.h>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "core/base/check.h"
#include "core/base/hand_over.h"

namespace sightline {
namespace {

absl::string_view View(const grpc_slice& slice) {
  return {reinterpret_cast<const char*>(GRPC_SLICE_START_PTR(slice)), GRPC_SLICE_LENGTH(slice)};
}

void AddNames(const grpc_auth_context* context, const char* property, Shown* shown) {
  grpc_auth_property_iterator names = grpc_auth_context_find_properties_by_name(context, property);
  while (const grpc_auth_property* const name = grpc_auth_property_iterator_next(&names)) {
    shown->certificate_names.emplace_back(name->value, name->value_length);
  }
}

absl::Status CheckCall(const TransportCredentials::Options& options,
                       const grpc_auth_context* context, const grpc_metadata* metadata,
                       size_t count) {
  Shown shown{.through_unix_socket = options.through_unix_socket};
  absl::string_view method;
  for (size_t i = 0; i < count; ++i) {
    if (View(metadata[i].key) == ":path") method = View(metadata[i].value);
    AddMetadata(View(metadata[i].key), View(metadata[i].value), &shown);
  }
  if (options.health_alone) {
    return RolesFor(method) == kNoRole
               ? absl::OkStatus()
               : absl::PermissionDeniedError("this connection is for health checks alone");
  }
  if (options.certificates != nullptr && grpc_auth_context_peer_is_authenticated(context) != 0) {
    AddNames(context, GRPC_X509_SAN_PROPERTY_NAME, &shown);
    AddNames(context, GRPC_X509_CN_PROPERTY_NAME, &shown);
  }
  return options.access->Check(method, shown);
}

// gRPC's C functions know no captures. It asks after it was told of the state, in other threads.
struct CheckState {
  const TransportCredentials::Options options;
  HandOver order = {};
};

void Process(void* state, grpc_auth_context* context, const grpc_metadata* metadata, size_t count,
             grpc_process_auth_metadata_done_cb done, void* user_data) {
  auto* const check = static_cast<CheckState*>(state);
  check->order.Acquire();
  const absl::Status status = CheckCall(check->options, context, metadata, count);
  const std::string message(status.message());
  done(user_data, nullptr, 0, nullptr, 0, static_cast<grpc_status_code>(status.code()),
       status.ok() ? nullptr : message.c_str());
}

void DeleteState(void* state) { delete static_cast<CheckState*>(state); }

}  // namespace

TransportCredentials::TransportCredentials(const Options& options) : options_(options) {
  credentials_ =
      options.certificates != nullptr ? MakeTls() : grpc_insecure_server_credentials_create();
  if (options.health_alone || (options.access != nullptr && options.access->active())) {
    CheckCalls();
  }
}

TransportCredentials::~TransportCredentials() { grpc_server_credentials_release(credentials_); }

void TransportCredentials::SetAuthMetadataProcessor(
    const std::shared_ptr<grpc::AuthMetadataProcessor>&) {
  SIGHTLINE_CHECK(false) << "calls are checked by the access control";
}

int TransportCredentials::AddPortToServer(const std::string& address, grpc_server* server) {
  return grpc_server_add_http2_port(server, address.c_str(), credentials_);
}

grpc_server_credentials* TransportCredentials::MakeTls() {
  const grpc_ssl_client_certificate_request_type request =
      options_.certificates->current()->client_ca.empty() ? GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE
      : options_.client_certificate_optional
          ? GRPC_SSL_REQUEST_CLIENT_CERTIFICATE_AND_VERIFY
          : GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY;
  return grpc_ssl_server_credentials_create_with_options(
      grpc_ssl_server_credentials_create_options_using_config_fetcher(
          request,
          [](void* self, grpc_ssl_server_certificate_config** config) {
            return static_cast<TransportCredentials*>(self)->Fetch(config);
          },
          this));
}

grpc_ssl_certificate_config_reload_status TransportCredentials::Fetch(
    grpc_ssl_server_certificate_config** config) {
  std::shared_ptr<const TlsBundle> now = options_.certificates->current();
  MutexLock lock(mutex_);
  if (now == fetched_) return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_UNCHANGED;
  const grpc_ssl_pem_key_cert_pair pair{.private_key = now->key.c_str(),
                                        .cert_chain = now->certificate.c_str()};
  // gRPC insists on authorities even where it asks nobody for a certificate; any will do then.
  const std::string& authorities = now->client_ca.empty() ? now->certificate : now->client_ca;
  *config = grpc_ssl_server_certificate_config_create(authorities.c_str(), &pair, 1);
  if (*config == nullptr) return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_FAIL;
  fetched_ = std::move(now);
  return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_NEW;
}

void TransportCredentials::CheckCalls() {
  auto* const state = new CheckState{.options = options_};
  state->order.Release();
  grpc_server_credentials_set_auth_metadata_processor(
      credentials_, {.process = &Process, .destroy = &DeleteState, .state = state});
}

}  // namespace sightline
