// SPDX-License-Identifier: Apache-2.0
//
// Who gets in, and who may do what: TLS, roles, tokens, Unix sockets, bounds on connections; over
// real sockets.
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/lib/client.h"
#include "client/lib/security.h"
#include "gmock/gmock.h"
#include "server/auth/role.h"
#include "tests/integration/raw_connection.h"
#include "tests/integration/server_harness.h"
#include "tests/integration/server_process.h"
#include "tests/integration/tls_handshake.h"
#include "tests/support/http_get.h"
#include "tests/support/temp_dir.h"
#include "tests/support/test_certificates.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using client::Security;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing_support::HttpGet;
using testing_support::IssuedCertificate;
using testing_support::TestAuthority;

constexpr char kQueryToken[] = "query-0123456789abcdef";
constexpr char kMetricsToken[] = "metrics-0123456789abcdef";

class SecurityTest : public ::testing::Test {
 protected:
  SecurityTest() { SetLogLevel(LogLevel::kOff); }

  std::string Write(const std::string& name, const std::string& text) const {
    std::ofstream(dir_.File(name)) << text;
    chmod(dir_.File(name).c_str(), 0600);
    return dir_.File(name);
  }
  // TLS with the authority's certificate.
  ServerOptions TlsOptions() const {
    const IssuedCertificate issued = Issue("server");
    ServerOptions options;
    options.log_level = LogLevel::kOff;
    options.tls.certificate = Write("cert.pem", issued.certificate);
    options.tls.key = Write("key.pem", issued.key);
    return options;
  }
  // ... for clients with a certificate of the same.
  ServerOptions MutualOptions() const {
    ServerOptions options = TlsOptions();
    options.tls.client_ca = Write("ca.pem", authority_.pem());
    return options;
  }
  IssuedCertificate Issue(const std::string& name) const {
    return authority_.Issue(
        {.common_name = name, .alternative_names = "IP:127.0.0.1,URI:spiffe://test/" + name});
  }
  void Start(const ServerOptions& options) {
    absl::StatusOr<std::unique_ptr<Server>> started = Server::Start(options);
    ASSERT_TRUE(started.ok()) << started.status();
    server_ = *std::move(started);
  }
  // What a client that trusts the authority shows.
  Security Trusting(const IssuedCertificate& own = {}, const std::string& token = "") const {
    return {.tls = true,
            .ca = authority_.pem(),
            .certificate = own.certificate,
            .key = own.key,
            .token = token};
  }
  std::string Target() const { return absl::StrCat("127.0.0.1:", server_->port()); }
  static client::Client ClientTo(const std::string& target, const Security& security) {
    client::ConnectionOptions options;
    options.retry.give_up_after = absl::ZeroDuration();
    options.channels = 1;
    options.security = security;
    return client::Client(client::MakeConnection(target, options));
  }
  absl::Status List(const Security& security) const {
    return ClientTo(Target(), security).ListScenes().status();
  }
  absl::Status Delete(const Security& security) const {
    return ClientTo(Target(), security).DeleteScene("scenes/none");
  }

  const testing_support::TempDir dir_;
  const TestAuthority authority_{"authority"}, stranger_{"stranger"};
  std::unique_ptr<Server> server_;
};

TEST_F(SecurityTest, TlsIsSpokenAndPlainIsNot) {
  Start(TlsOptions());
  EXPECT_EQ(List(Trusting()), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnavailable(List({})));
  // A client that trusts somebody else does not talk to this server.
  EXPECT_TRUE(absl::IsUnavailable(List({.tls = true, .ca = stranger_.pem()})));
}

TEST_F(SecurityTest, MutualTlsWantsAGoodCertificate) {
  Start(MutualOptions());
  EXPECT_EQ(List(Trusting(Issue("client"))), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnavailable(List(Trusting())));
  EXPECT_TRUE(absl::IsUnavailable(List(Trusting(stranger_.Issue({.common_name = "client"})))));
  EXPECT_TRUE(absl::IsUnavailable(
      List(Trusting(authority_.Issue({.common_name = "client", .until_seconds = -60})))));
}

TEST_F(SecurityTest, ABadCertificateDoesNotStart) {
  ServerOptions options = TlsOptions();
  Write("cert.pem", authority_.Issue({.common_name = "s", .until_seconds = -60}).certificate);
  EXPECT_THAT(std::string(Server::Start(options).status().message()), HasSubstr("has expired"));
}

TEST_F(SecurityTest, ANewCertificateIsTakenAndABadOneIsNot) {
  Start(TlsOptions());
  ASSERT_EQ(List(Trusting()), absl::OkStatus());
  // Garbage is refused, and the server goes on with what it had.
  Write("cert.pem", "garbage");
  EXPECT_FALSE(server_->ReloadSecurity().ok());
  EXPECT_EQ(List(Trusting()), absl::OkStatus());
  // From another authority: who trusts the first no longer connects, who trusts the other does.
  const IssuedCertificate next =
      stranger_.Issue({.common_name = "server", .alternative_names = "IP:127.0.0.1"});
  Write("cert.pem", next.certificate);
  Write("key.pem", next.key);
  ASSERT_TRUE(server_->ReloadSecurity().ok());
  EXPECT_TRUE(absl::IsUnavailable(List(Trusting())));
  const Security other{.tls = true, .ca = stranger_.pem()};
  EXPECT_EQ(List(other), absl::OkStatus());
}

// Who may connect changes with the authority of the clients: those of the new one, of both for as
// long as the file names both, and whatever is broken changes nothing.
TEST_F(SecurityTest, ANewClientAuthorityIsTakenAndTheOldOneIsNot) {
  Start(MutualOptions());
  const Security old_client = Trusting(Issue("client"));
  const Security new_client = Trusting(stranger_.Issue({.common_name = "client"}));
  const client::Client connected = ClientTo(Target(), old_client);
  ASSERT_TRUE(connected.ListScenes().ok());
  EXPECT_TRUE(absl::IsUnavailable(List(new_client)));
  Write("ca.pem", absl::StrCat(authority_.pem(), stranger_.pem()));
  ASSERT_TRUE(server_->ReloadSecurity().ok());
  EXPECT_EQ(List(old_client), absl::OkStatus());
  EXPECT_EQ(List(new_client), absl::OkStatus());
  Write("ca.pem", stranger_.pem());
  ASSERT_TRUE(server_->ReloadSecurity().ok());
  EXPECT_TRUE(absl::IsUnavailable(List(old_client)));
  EXPECT_EQ(List(new_client), absl::OkStatus());
  Write("ca.pem", "garbage");
  EXPECT_FALSE(server_->ReloadSecurity().ok());
  EXPECT_TRUE(absl::IsUnavailable(List(old_client)));
  EXPECT_EQ(List(new_client), absl::OkStatus());
  // A certificate is asked for when a connection is made.
  EXPECT_TRUE(connected.ListScenes().ok());
}

TEST_F(SecurityTest, RolesComeFromCertificates) {
  ServerOptions options = MutualOptions();
  options.access_file = Write("access", "query cert spiffe://test/reader\nadmin cert operator\n");
  Start(options);
  EXPECT_EQ(List(Trusting(Issue("reader"))), absl::OkStatus());
  const absl::Status denied = Delete(Trusting(Issue("reader")));
  EXPECT_TRUE(absl::IsPermissionDenied(denied)) << denied;
  EXPECT_THAT(std::string(denied.message()), HasSubstr("wants the role admin"));
  // Known by the common name; there is no such scene, but it was looked for.
  EXPECT_TRUE(absl::IsNotFound(Delete(Trusting(Issue("operator")))));
  // Connected by a good certificate that the file does not name.
  EXPECT_TRUE(absl::IsUnauthenticated(List(Trusting(Issue("guest")))));
}

TEST_F(SecurityTest, RolesComeFromTokens) {
  ServerOptions options = MutualOptions();
  options.client_certificate_optional = true;
  options.metrics_listen = "127.0.0.1:0";
  options.access_file =
      Write("access", absl::StrCat("query token reader plain:", kQueryToken,
                                   "\nmetrics token prometheus plain:", kMetricsToken,
                                   "\nadmin cert operator\n"));
  Start(options);
  EXPECT_EQ(List(Trusting({}, kQueryToken)), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnauthenticated(List(Trusting())));
  EXPECT_TRUE(absl::IsUnauthenticated(List(Trusting({}, "query-0123456789abcdeF"))));
  EXPECT_TRUE(absl::IsPermissionDenied(Delete(Trusting({}, kQueryToken))));
  EXPECT_TRUE(absl::IsPermissionDenied(List(Trusting({}, kMetricsToken))));
  EXPECT_TRUE(absl::IsNotFound(Delete(Trusting(Issue("operator")))));
  // Health is for everybody.
  EXPECT_TRUE(ClientTo(Target(), Trusting()).CheckHealth("").ok());
  // And the same for the page of metrics.
  const auto page = [&](const std::string& token) {
    return HttpGet(server_->metrics_port(), "/metrics", "Authorization: Bearer " + token + "\r\n");
  };
  EXPECT_EQ(page(kMetricsToken).code, 200);
  EXPECT_THAT(page(kMetricsToken).body, HasSubstr("sightline_refused_calls_total 4\n"));
  EXPECT_EQ(page(kQueryToken).code, 403);
  EXPECT_EQ(page("wrong").code, 401);
  EXPECT_EQ(HttpGet(server_->metrics_port(), "/metrics").code, 401);
  EXPECT_EQ(HttpGet(server_->metrics_port(), "/readyz").code, 200);
  // The probe has neither certificate nor token.
  EXPECT_EQ(HttpGet(server_->metrics_port(), "/livez").code, 200);
  // A token that the file no longer has is out at once, on connections that there are, too.
  const client::Client reader = ClientTo(Target(), Trusting({}, kQueryToken));
  EXPECT_TRUE(reader.ListScenes().ok());
  Write("access", "admin cert operator\n");
  ASSERT_TRUE(server_->ReloadSecurity().ok());
  EXPECT_TRUE(absl::IsUnauthenticated(reader.ListScenes().status()));
}

// A stream is refused like any other call.
TEST_F(SecurityTest, StreamsAreCheckedToo) {
  ServerOptions options;
  options.scenes = {"builtin:box:1000"};
  options.access_file = Write("access", absl::StrCat("query token t plain:", kQueryToken, "\n"));
  ServerHarness harness(options);
  TileStream stream(harness, BoxHeader());
  v1::TraceTilesResponse response;
  EXPECT_FALSE(stream.Read(&response));
  EXPECT_EQ(stream.Finish().error_code(), grpc::StatusCode::UNAUTHENTICATED);
  v1::Scene scene;
  EXPECT_EQ(harness.CreateScene(WallUpload("wall"), &scene).error_code(),
            grpc::StatusCode::UNAUTHENTICATED);
}

// A role's limits are each caller's: two tokens from one address do not share them, and one token
// on two connections has no more.
TEST_F(SecurityTest, LimitsBelongToTheTokenAndNotToTheAddress) {
  ServerOptions options;
  options.scenes = {"builtin:box:1000"};
  constexpr char kOther[] = "other-0123456789abcdef";
  options.access_file =
      Write("access", absl::StrCat("query,admin token a plain:", kQueryToken,
                                   "\nquery,admin token b plain:", kOther,
                                   "\nlimit query streams 1\nlimit admin uploads 1\n"));
  Start(options);
  using Stream = grpc::ClientReaderWriter<v1::TraceTilesRequest, v1::TraceTilesResponse>;
  struct Call {
    Call(const std::string& target, const std::string& token)
        : channel(grpc::CreateChannel(target, grpc::InsecureChannelCredentials())) {
      context.AddMetadata("authorization", "Bearer " + token);
    }
    ~Call() {
      if (stream == nullptr) return;
      context.TryCancel();
      stream->Finish();
    }
    bool Opens() {
      stream = v1::VisibilityService::NewStub(channel)->TraceTiles(&context);
      stream->Write(BoxHeader());
      v1::TraceTilesResponse response;
      return stream->Read(&response) && response.has_opened();
    }
    const std::shared_ptr<grpc::Channel> channel;
    grpc::ClientContext context;
    std::unique_ptr<Stream> stream;
  };
  auto first = std::make_unique<Call>(Target(), kQueryToken);
  EXPECT_TRUE(first->Opens());
  {
    Call more(Target(), kQueryToken);
    EXPECT_FALSE(more.Opens());
    const grpc::Status refused = more.stream->Finish();
    more.stream.reset();
    EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_EQ(ReasonIn(refused), "QUOTA_EXCEEDED");
    EXPECT_THAT(refused.error_message(), HasSubstr("token:a"));
  }
  Call other(Target(), kOther);
  EXPECT_TRUE(other.Opens());
  // An upload that is under way holds its share. Only once it is in does another try: who comes
  // first has the share, and that might be the other.
  Call uploading(Target(), kQueryToken);
  v1::Scene scene;
  const uint64_t before = server_->scenes().MemoryBytes();
  const auto writer =
      v1::SceneService::NewStub(uploading.channel)->CreateScene(&uploading.context, &scene);
  writer->Write(WallUpload("wall")[0]);
  EXPECT_TRUE(testing_support::Until("the upload is in",
                                     [&] { return server_->scenes().MemoryBytes() > before; }));
  const client::Client same = ClientTo(Target(), {.token = kQueryToken});
  const absl::Status second =
      same.CreateScene({.scene_id = "x", .builtin = "builtin:box:100"}).status();
  EXPECT_TRUE(absl::IsResourceExhausted(second)) << second;
  EXPECT_THAT(std::string(second.message()), HasSubstr("uploads at once of token:a"));
  uploading.context.TryCancel();
  EXPECT_FALSE(writer->Finish().ok());
}

// Were one of two believed by the check and the other one by the limits, these would not hold.
TEST_F(SecurityTest, TwoAuthorizationsAreNone) {
  ServerOptions options;
  options.access_file = Write("access", absl::StrCat("query token a plain:", kQueryToken, "\n"));
  Start(options);
  const auto stub =
      v1::SceneService::NewStub(grpc::CreateChannel(Target(), grpc::InsecureChannelCredentials()));
  const std::string good = std::string("Bearer ") + kQueryToken;
  for (const auto& both : {std::pair<std::string, std::string>{"Bearer junk", good},
                           {good, "Bearer junk"},
                           {good, good}}) {
    grpc::ClientContext context;
    context.AddMetadata("authorization", both.first);
    context.AddMetadata("authorization", both.second);
    v1::ListScenesResponse response;
    const grpc::Status status = stub->ListScenes(&context, {}, &response);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAUTHENTICATED);
    EXPECT_THAT(status.error_message(), HasSubstr("2 authorizations were sent; send one"));
  }
}

// An answer that its client does not let go out holds the item's rays: another stream of the same
// caller has what is left of its role's limit, and another caller has all of it.
TEST_F(SecurityTest, RaysBelongToTheTokenToo) {
  ServerOptions options;
  options.scenes = {"builtin:box:1000"};
  constexpr char kOther[] = "other-0123456789abcdef";
  options.access_file =
      Write("access", absl::StrCat("query token a plain:", kQueryToken,
                                   "\nquery token b plain:", kOther, "\nlimit query rays 5000\n"));
  Start(options);
  struct Stream {
    Stream(const std::string& target, const std::string& token, int64_t result_credit)
        : stub(v1::VisibilityService::NewStub(
              grpc::CreateChannel(target, grpc::InsecureChannelCredentials()))) {
      context.AddMetadata("authorization", "Bearer " + token);
      call = stub->TraceTiles(&context);
      v1::TraceTilesRequest header = BoxHeader();
      header.mutable_header()->mutable_stream()->set_result_credit_rays(result_credit);
      call->Write(header);
      v1::TraceTilesResponse response;
      EXPECT_TRUE(call->Read(&response) && response.has_opened());
    }
    ~Stream() {
      context.TryCancel();
      call->Finish();
    }
    // 4,096 rays.
    void Ask(uint64_t id) const { EXPECT_TRUE(call->Write(TileRequest(id, 0, 0, 64, 64))); }
    v1::ItemStatus Answer() const {
      v1::TraceTilesResponse response;
      EXPECT_TRUE(call->Read(&response));
      return response.reply().header().status();
    }
    const std::unique_ptr<v1::VisibilityService::Stub> stub;
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReaderWriter<v1::TraceTilesRequest, v1::TraceTilesResponse>> call;
  };
  const auto waits = [&](uint64_t rays) {
    return testing_support::Until("so many rays wait",
                                  [&] { return server_->queued_rays() == rays; });
  };
  // Credit of one ray is enough for one answer, and leaves none for the next.
  const Stream holding(Target(), kQueryToken, 1);
  holding.Ask(1);
  EXPECT_EQ(holding.Answer().code(), 0);
  holding.Ask(2);
  ASSERT_TRUE(waits(4096));
  const Stream more(Target(), kQueryToken, 0);
  more.Ask(1);
  const v1::ItemStatus refused = more.Answer();
  EXPECT_EQ(refused.code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << refused.message();
  EXPECT_EQ(refused.reason(), v1::ERROR_REASON_QUOTA_EXCEEDED) << refused.message();
  EXPECT_EQ(refused.metadata().at("limit"), "limit rays of the access file");
  EXPECT_EQ(refused.metadata().at("limit_value"), "5000");
  const Stream other(Target(), kOther, 0);
  other.Ask(1);
  EXPECT_EQ(other.Answer().code(), 0);
  // What goes out makes room.
  v1::TraceTilesRequest grant;
  grant.mutable_grant_result_credit()->set_rays(8192);
  EXPECT_TRUE(holding.call->Write(grant));
  EXPECT_EQ(holding.Answer().code(), 0);
  ASSERT_TRUE(waits(0));
  more.Ask(2);
  EXPECT_EQ(more.Answer().code(), 0);
}

// What a caller may keep on the server: scenes until they are deleted, and bytes of uploads until
// their calls end.
TEST_F(SecurityTest, ScenesAndUploadBytesBelongToTheTokenToo) {
  ServerOptions options;
  constexpr char kOther[] = "other-0123456789abcdef";
  options.access_file =
      Write("access", absl::StrCat("query,admin token a plain:", kQueryToken,
                                   "\nquery,admin token b plain:", kOther,
                                   "\nlimit admin scenes 2\nlimit admin upload-bytes 20000\n"));
  Start(options);
  const client::Client a = ClientTo(Target(), {.token = kQueryToken});
  const client::Client b = ClientTo(Target(), {.token = kOther});
  const auto create = [](const client::Client& client, const char* id) {
    return client.CreateScene({.scene_id = id, .builtin = "builtin:box:300"}).status();
  };
  EXPECT_EQ(create(a, "one"), absl::OkStatus());
  EXPECT_EQ(create(a, "two"), absl::OkStatus());
  const absl::Status third = create(a, "three");
  EXPECT_TRUE(absl::IsResourceExhausted(third)) << third;
  EXPECT_THAT(std::string(third.message()), HasSubstr("scenes at once of token:a"));
  EXPECT_EQ(create(b, "three"), absl::OkStatus());
  // One that could not be made takes nothing; whoever deletes one gives its place back.
  EXPECT_TRUE(absl::IsAlreadyExists(create(b, "one")));
  ASSERT_TRUE(b.DeleteScene("scenes/one").ok());
  EXPECT_EQ(create(a, "four"), absl::OkStatus());
  EXPECT_TRUE(absl::IsResourceExhausted(create(a, "five")));
  EXPECT_TRUE(absl::IsNotFound(b.DeleteScene("scenes/one")));

  // 1,000 points are 24,000 bytes, which are too many; 500 at a time are not.
  const std::vector<double> positions(3000, 0.25);
  const auto keep = [&](size_t points, const char* id) {
    client::PointSetSource source;
    source.scene = "scenes/two";
    source.point_set_id = id;
    source.points.positions = std::span(positions).first(3 * points);
    return a.CreatePointSet(source).status();
  };
  const absl::Status large = keep(1000, "large");
  EXPECT_TRUE(absl::IsResourceExhausted(large)) << large;
  EXPECT_THAT(std::string(large.message()), HasSubstr("upload-bytes at once of token:a"));
  for (const char* id : {"s1", "s2", "s3"}) EXPECT_EQ(keep(500, id), absl::OkStatus());
}

// By the real process, in whose log an operator would see it.
TEST_F(SecurityTest, ListeningToTheWorldInTheOpenIsWarnedAbout) {
  (void)MutualOptions();  // Writes the certificates.
  const std::string roles = Write("access", "query unix\n");
  using Flags = std::vector<std::string>;
  const auto warnings = [](const Flags& flags) {
    ServerProcess process(flags);
    EXPECT_GT(process.Port(), 0);
    std::vector<std::string> found;
    for (const char* event :
         {"listening_without_tls", "listening_without_roles", "metrics_without_roles"}) {
      if (!process.HasSaid(event)) continue;
      EXPECT_TRUE(
          process.HasSaid(absl::StrCat("level=warning event=", event, " address=0.0.0.0:")));
      found.emplace_back(event);
    }
    return found;
  };
  const Flags tls = {"--tls-cert=" + dir_.File("cert.pem"), "--tls-key=" + dir_.File("key.pem")};
  const auto with = [](Flags flags, const Flags& more) {
    flags.insert(flags.end(), more.begin(), more.end());
    return flags;
  };
  const Flags world = {"--listen=0.0.0.0:0"};
  EXPECT_THAT(warnings(world), ElementsAre("listening_without_tls", "listening_without_roles"));
  EXPECT_THAT(
      warnings(with(world, {"--metrics-listen=0.0.0.0:0"})),
      ElementsAre("listening_without_tls", "listening_without_roles", "metrics_without_roles"));
  EXPECT_THAT(warnings(with(world, tls)), ElementsAre("listening_without_roles"));
  EXPECT_THAT(warnings(with(world, {"--access-file=" + roles})),
              ElementsAre("listening_without_tls"));
  EXPECT_THAT(warnings(with(with(world, tls), {"--access-file=" + roles})), IsEmpty());
  // Whoever has a certificate of the clients' authority is known.
  const Flags mutual = with(tls, {"--tls-client-ca=" + dir_.File("ca.pem")});
  EXPECT_THAT(warnings(with(world, mutual)), IsEmpty());
  EXPECT_THAT(warnings(with(with(world, mutual), {"--tls-client-auth=optional"})),
              ElementsAre("listening_without_roles"));
  // Within the machine nothing is to be warned about.
  EXPECT_THAT(warnings({"--listen=127.0.0.1:0", "--metrics-listen=127.0.0.1:0"}), IsEmpty());
  EXPECT_THAT(warnings({"--listen=127.0.0.1:0", "--listen=unix:" + dir_.File("s.sock")}),
              IsEmpty());
}

TEST_F(SecurityTest, UnixSocketsServeBesideTcp) {
  const std::string path = dir_.File("s.sock");
  ServerOptions options = TlsOptions();
  options.listen.push_back("unix:" + path);
  options.access_file = Write("access", "query unix\n");
  Start(options);
  const client::Client local = ClientTo("unix:" + path, {});
  EXPECT_TRUE(local.ListScenes().ok()) << local.ListScenes().status();
  EXPECT_TRUE(absl::IsPermissionDenied(local.DeleteScene("scenes/none")));
  // What the socket's file allows does not hold for TCP.
  EXPECT_TRUE(absl::IsUnauthenticated(List(Trusting())));
  server_.reset();
  EXPECT_NE(access(path.c_str(), F_OK), 0);
}

// Handshakes that stop half way take up all the room that there is, for no more than seconds, and
// who was in before is served meanwhile.
TEST_F(SecurityTest, StalledHandshakesMakeRoomAgain) {
  constexpr int kStalled = 24;
  ServerOptions options = TlsOptions();
  options.limits.max_connections = options.limits.max_connections_per_address = kStalled + 1;
  Start(options);
  client::Client before = ClientTo(Target(), Trusting());
  ASSERT_EQ(before.ListScenes().status(), absl::OkStatus());

  std::vector<std::unique_ptr<RawConnection>> stalled;
  for (int i = 0; i < kStalled; ++i) {
    const RawConnection& connection =
        *stalled.emplace_back(std::make_unique<RawConnection>(server_->port()));
    ASSERT_TRUE(connection.connected());
    TlsHandshake handshake;
    switch (i % 4) {
      case 0:  // Nothing at all.
        break;
      case 1:  // Its first record, but for most of it.
        connection.Send(handshake.Next("").substr(0, 11));
        break;
      case 2:  // Its first record, and no answer to the server's.
        connection.Send(handshake.Next(""));
        EXPECT_NE(connection.ReadSome(), "");
        break;
      default:  // All of it, and then no word of HTTP/2.
        connection.Send(handshake.Next(""));
        while (!handshake.done()) {
          const std::string heard = connection.ReadSome();
          ASSERT_NE(heard, "") << "cut off half way";
          connection.Send(handshake.Next(heard));
        }
        break;
    }
    EXPECT_EQ(before.ListScenes().status(), absl::OkStatus());
  }
  // One connection more finds no room before some of them have gone.
  client::ConnectionOptions patient;
  patient.channels = 1;
  patient.security = Trusting();
  patient.retry.give_up_after = absl::Seconds(60);
  EXPECT_EQ(client::Client(client::MakeConnection(Target(), patient)).ListScenes().status(),
            absl::OkStatus());
  for (size_t i = 0; i < stalled.size(); ++i) {
    EXPECT_TRUE(stalled[i]->EndsWithin(absl::Seconds(40))) << "stalled in way " << i % 4;
  }
  EXPECT_EQ(before.ListScenes().status(), absl::OkStatus());
}

TEST(MethodRolesTest, EveryMethodOfEveryServiceIsInTheTable) {
  int methods = 0;
  const std::string folder = std::string(SIGHTLINE_SOURCE_DIR) + "/proto";
  for (const auto& entry : std::filesystem::directory_iterator(folder + "/sightline/v1")) {
    const std::string file = "sightline/v1/" + entry.path().filename().string();
    if (!file.ends_with("_service.proto")) continue;
    const auto* const descriptor =
        google::protobuf::DescriptorPool::generated_pool()->FindFileByName(file);
    ASSERT_NE(descriptor, nullptr) << file;
    for (int s = 0; s < descriptor->service_count(); ++s) {
      const google::protobuf::ServiceDescriptor* const service = descriptor->service(s);
      for (int m = 0; m < service->method_count(); ++m, ++methods) {
        const std::string name =
            absl::StrCat("/", service->full_name(), "/", service->method(m)->name());
        EXPECT_TRUE(IsKnownMethod(name)) << name;
        EXPECT_NE(RolesFor(name), kNoRole) << name;
      }
    }
  }
  EXPECT_GE(methods, 16);
  EXPECT_EQ(RolesFor("/sightline.v1.SceneService/DeleteScene"), kAdminRole);
  EXPECT_EQ(RolesFor("/sightline.v1.SceneService/ListSceneObjects"), kQueryRole | kAdminRole);
  EXPECT_EQ(RolesFor("/sightline.v1.VisibilityService/TraceTiles"), kQueryRole);
}

// In a service that there is, one whose name begins like another's, and in one that there is not.
TEST(MethodRolesTest, AMethodThatTheTableDoesNotNameIsTheAdminsAlone) {
  for (const std::string method :
       {"CapabilityService/SetCapabilities", "VisibilityService/TraceTilesOfAll",
        "PointSetService/GetPointSets", "SceneService/ListScenesOfOthers", "SceneService/GetScen",
        "NewService/Anything"}) {
    const std::string name = "/sightline.v1." + method;
    EXPECT_FALSE(IsKnownMethod(name)) << name;
    EXPECT_EQ(RolesFor(name), kAdminRole) << name;
  }
}

TEST_F(SecurityTest, TheClientKeepsItsSecrets) {
  const std::string token = Write("token", absl::StrCat(kQueryToken, "\n"));
  const auto load = [&](const client::SecurityFiles& files, const std::string& target) {
    return client::LoadSecurity(files, target);
  };
  EXPECT_EQ(load({.token = token}, "127.0.0.1:1")->token, kQueryToken);
  EXPECT_EQ(load({.token = token}, "unix:s.sock")->token, kQueryToken);
  EXPECT_THAT(std::string(load({.token = token}, "example.org:1").status().message()),
              HasSubstr("in the clear"));
  EXPECT_TRUE(load({.ca = Write("ca", authority_.pem()), .token = token}, "example.org:1").ok());
  EXPECT_THAT(std::string(load({.ca = token}, "localhost:1").status().message()),
              HasSubstr("token holds no CERTIFICATE in PEM form"));
  EXPECT_FALSE(load({.certificate = token}, "localhost:1").ok());
  EXPECT_FALSE(load({.token = Write("empty", "\n")}, "localhost:1").ok());
  EXPECT_FALSE(load({.token = dir_.File("none")}, "localhost:1").ok());
  chmod(token.c_str(), 0644);
  EXPECT_TRUE(absl::IsPermissionDenied(load({.token = token}, "localhost:1").status()));
}

}  // namespace
}  // namespace sightline
