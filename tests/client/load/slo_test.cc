// SPDX-License-Identifier: Apache-2.0
#include "client/load/slo.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::load {
namespace {

using testing::EndsWith;
using testing::HasSubstr;

// 990 answers of 10 ms, 10 of 100 ms, and `failed` failures, in one second.
Measurement Measured(uint64_t failed) {
  Measurement m;
  m.elapsed = absl::Seconds(1);
  m.all.planned.Record(absl::Milliseconds(10), 990);
  m.all.planned.Record(absl::Milliseconds(100), 10);
  m.all.answered = m.all.answered_in_time = 1000;
  m.all.failed = failed;
  m.all.requests = 1000 + failed;
  return m;
}

bool Holds(const char* text, const Measurement& measured) {
  const absl::StatusOr<Slo> slo = ParseSlo(text);
  EXPECT_TRUE(slo.ok()) << slo.status();
  return Held(slo->Judge(measured));
}

TEST(SloTest, EachClauseIsJudged) {
  const Measurement m = Measured(0);
  EXPECT_TRUE(Holds("p99=11ms", m));
  EXPECT_FALSE(Holds("p99.1=99ms", m));
  EXPECT_TRUE(Holds("max=100ms", m));
  EXPECT_FALSE(Holds("max=99.9ms", m));
  EXPECT_TRUE(Holds("mean=11ms", m));
  EXPECT_FALSE(Holds("mean=10.8ms", m));
  EXPECT_TRUE(Holds("rate=1000", m));
  EXPECT_FALSE(Holds("rate=1001", m));
  EXPECT_FALSE(Holds("p50=20ms,max=50ms", m));
  EXPECT_TRUE(Holds("p50=20ms,max=0.5s,rate=10,errors=0", m));
}

TEST(SloTest, ErrorsAreNotForgivenUnlessTheyAreNamed) {
  EXPECT_FALSE(Holds("p50=1s", Measured(1)));
  EXPECT_TRUE(Holds("p50=1s,errors=0.1%", Measured(1)));
  EXPECT_TRUE(Holds("p50=1s,errors=0.001", Measured(1)));
  EXPECT_FALSE(Holds("p50=1s,errors=0.1%", Measured(2)));
}

TEST(SloTest, NothingMeasuredMeetsNoLatency) {
  EXPECT_FALSE(Holds("p99=1h", Measurement()));
  EXPECT_FALSE(Holds("errors=100%", Measurement()));
  EXPECT_TRUE(Held(Slo().Judge(Measurement())));
}

// Of a server that hangs: the run gave up on everything.
TEST(SloTest, WithoutAnAnswerNothingIsMet) {
  Measurement m;
  m.all.requests = m.all.failed = 10;
  m.all.planned.Record(absl::Seconds(10), 10);
  EXPECT_FALSE(Holds("p99=20s,errors=100%", m));
  EXPECT_FALSE(Holds("errors=100%", m));
  m.all.requests = 11;
  m.all.answered = 1;
  m.all.planned.Record(absl::Seconds(1));
  EXPECT_TRUE(Holds("p99=20s,errors=100%", m));
}

TEST(SloTest, MistakesAreNamed) {
  for (const char* text :
       {"", "p99", "p99=", "p99=20", "p101=1ms", "p-1=1ms", "q99=1ms", "p99=-1ms", "p99=0s",
        "errors=-1%", "errors=101%", "errors=x", "rate=0", "rate=inf", "mean=5", "p99=1ms,",
        "p99=1ms,p99=2ms", "p99=inf", "pnan=1ms"}) {
    const absl::StatusOr<Slo> slo = ParseSlo(text);
    EXPECT_EQ(slo.status().code(), absl::StatusCode::kInvalidArgument) << text;
    EXPECT_THAT(std::string(slo.status().message()), HasSubstr("'")) << text;
  }
}

TEST(SloTest, ResultsAreTold) {
  const absl::StatusOr<Slo> slo = ParseSlo("p99.9=20ms,errors=0.5%,rate=2000");
  ASSERT_TRUE(slo.ok());
  const std::vector<SloResult> results = slo->Judge(Measured(10));
  ASSERT_EQ(results.size(), 3u);
  EXPECT_EQ(DescribeSlo(results[0]), "p99.9 100 ms of 20 ms");
  EXPECT_EQ(DescribeSlo(results[1]), "errors 0.99 % of 0.5 %");
  EXPECT_EQ(DescribeSlo(results[2]), "rate 1000/s of 2000/s");
  EXPECT_EQ(DescribeSlo(slo->Judge(Measurement())[0]), "p99.9: no answer");
  // No exponents for people to decode.
  const absl::StatusOr<Slo> long_one = ParseSlo("max=5m");
  ASSERT_TRUE(long_one.ok());
  Measurement slow;
  slow.all.planned.Record(absl::Milliseconds(3370.4));
  EXPECT_EQ(DescribeSlo(long_one->Judge(slow)[0]), "max 3370 ms of 300000 ms");
  slow.all.planned.Record(absl::Milliseconds(999'999.7));
  EXPECT_EQ(DescribeSlo(long_one->Judge(slow)[0]), "max 1000000 ms of 300000 ms");
  const absl::StatusOr<Slo> fast = ParseSlo("rate=20000,p50=1ns,errors=0.00001%");
  ASSERT_TRUE(fast.ok());
  const std::vector<SloResult> extremes = fast->Judge(Measured(10));
  EXPECT_EQ(DescribeSlo(extremes[0]), "rate 1000/s of 20000/s");
  EXPECT_THAT(DescribeSlo(extremes[1]), EndsWith(" ms of 0.000001 ms"));
  EXPECT_EQ(DescribeSlo(extremes[2]), "errors 0.99 % of 0.00001 %");
}

}  // namespace
}  // namespace sightline::load
