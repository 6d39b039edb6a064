// SPDX-License-Identifier: Apache-2.0
#include "client/load/knee.h"

#include <gtest/gtest.h>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/load/driver.h"
#include "client/load/recorder.h"
#include "tests/client/load/fake_target.h"
#include "tests/client/load/manual_clock.h"

namespace sightline::load {
namespace {

absl::StatusOr<KneeTrial> Model(double rate, double capacity) {
  return KneeTrial{.rate = rate, .answered = std::min(rate, capacity), .held = rate <= capacity};
}

TEST(KneeTest, TheKneeIsFoundFromEitherSide) {
  for (const double capacity : {3.0, 50.0, 51.0, 777.0, 123'456.0}) {
    for (const double first : {1.0, 50.0, 1000.0}) {
      Knee knee;
      ASSERT_TRUE(FindKnee(
                      first, [&](double rate) { return Model(rate, capacity); }, &knee)
                      .ok());
      EXPECT_LE(knee.rate, capacity) << first;
      EXPECT_GE(knee.rate * (1 + kKneePrecision), capacity * 0.999) << first;
      EXPECT_GT(knee.missed, capacity);
      EXPECT_LE(knee.trials.size(), static_cast<size_t>(kMaxTrials));
    }
  }
}

TEST(KneeTest, OneBadTrialIsForgiven) {
  int trials = 0;
  Knee knee;
  const auto trial = [&](double rate) {
    absl::StatusOr<KneeTrial> result = Model(rate, 1000);
    if (++trials == 2) result->held = false;  // 200, which holds otherwise.
    return result;
  };
  ASSERT_TRUE(FindKnee(100, trial, &knee).ok());
  EXPECT_GE(knee.rate, 950);
}

TEST(KneeTest, WhatNeverHoldsHasNoKnee) {
  Knee knee;
  ASSERT_TRUE(FindKnee(
                  100, [](double rate) { return Model(rate, 0); }, &knee)
                  .ok());
  EXPECT_EQ(knee.rate, 0);
  EXPECT_LE(knee.trials.size(), static_cast<size_t>(kMaxTrials));
}

TEST(KneeTest, WhatNeverMissesEndsAtTheHighestRate) {
  Knee knee;
  ASSERT_TRUE(FindKnee(
                  1, [](double rate) { return Model(rate, 1e300); }, &knee)
                  .ok());
  EXPECT_EQ(knee.missed, 0);
  EXPECT_EQ(knee.rate, kHighestRate);
  EXPECT_EQ(knee.trials.size(), 21u);
}

// What a trial met and a whole run does not gives way, step by step.
TEST(KneeTest, AKneeThatDoesNotHoldStepsBack) {
  for (const double capacity : {1000.0, 950.0, 700.0}) {
    Knee knee{.rate = 1000, .missed = 1040, .trials = {{.rate = 1000, .held = true}}};
    std::vector<double> rates;
    ASSERT_TRUE(HoldKnee(&knee, [&](double rate) {
                  rates.push_back(rate);
                  return Model(rate, capacity);
                }).ok());
    EXPECT_LE(knee.rate, capacity);
    EXPECT_GE(knee.rate, std::min(capacity, 1000.0) * kStepBack);
    EXPECT_EQ(rates.back(), knee.rate);
    ASSERT_EQ(knee.trials.size(), 1 + rates.size());  // The one of before, and the runs.
    EXPECT_FALSE(knee.trials[0].whole);
    for (size_t i = 0; i < rates.size(); ++i) {
      EXPECT_EQ(knee.trials[1 + i].rate, rates[i]);
      EXPECT_TRUE(knee.trials[1 + i].whole);
      EXPECT_EQ(knee.trials[1 + i].held, i + 1 == rates.size());
    }
    EXPECT_DOUBLE_EQ(knee.missed, rates.size() == 1 ? 1040 : knee.rate / kStepBack);
  }
}

// A rate is not called the knee because nothing below it was tried.
TEST(KneeTest, SteppingBackEndsWithoutAKnee) {
  Knee knee{.rate = 1000};
  int runs = 0;
  ASSERT_TRUE(HoldKnee(&knee, [&](double rate) {
                ++runs;
                return Model(rate, 1);
              }).ok());
  EXPECT_EQ(runs, kStepsBack + 1);
  EXPECT_EQ(knee.trials.size(), static_cast<size_t>(kStepsBack + 1));
  EXPECT_EQ(knee.rate, 0);
  EXPECT_EQ(knee.missed, knee.trials.back().rate);
  Knee other{.rate = 1000};
  const absl::Status gone =
      HoldKnee(&other, [](double) -> absl::StatusOr<KneeTrial> { return absl::AbortedError("x"); });
  EXPECT_TRUE(absl::IsAborted(gone)) << gone;
  EXPECT_EQ(other.rate, 1000) << "by trials it still is the knee";
  // A step back that did not come to its end is no knee.
  const absl::Status cut = HoldKnee(&other, [](double rate) -> absl::StatusOr<KneeTrial> {
    if (rate < 1000) return absl::AbortedError("x");
    return Model(rate, 1);
  });
  EXPECT_TRUE(absl::IsAborted(cut)) << cut;
  EXPECT_EQ(other.rate, 0);
  EXPECT_EQ(other.missed, 1000);
}

TEST(KneeTest, AnErrorEndsTheSearchAndKeepsWhatWasFound) {
  int trials = 0;
  Knee knee;
  const auto trial = [&](double rate) -> absl::StatusOr<KneeTrial> {
    if (++trials == 3) return absl::UnavailableError("gone");
    return Model(rate, 100);
  };
  EXPECT_TRUE(absl::IsUnavailable(FindKnee(1, trial, &knee)));
  EXPECT_EQ(trials, 3);
  EXPECT_EQ(knee.trials.size(), 2u);
  EXPECT_EQ(knee.rate, 2);
}

// Of good answers that come too late to keep up, and of slow ones.
TEST(KneeTest, ATrialHoldsIfItKeepsUpAndMeetsTheObjective) {
  const Slo slo = *ParseSlo("p50=10ms");
  Measurement measured;
  measured.all.requests = measured.all.answered = 100;
  measured.all.answered_in_time = 95;
  measured.all.planned.Record(absl::Milliseconds(5), 100);
  EXPECT_TRUE(JudgeTrial(7, measured, slo)->held);
  measured.all.answered_in_time = 94;
  EXPECT_FALSE(JudgeTrial(7, measured, slo)->held);
  measured.all.answered_in_time = 100;
  measured.all.planned.Record(absl::Milliseconds(50), 200);
  EXPECT_FALSE(JudgeTrial(7, measured, slo)->held);
}

// Neither a trial nor a run in full: a step back from it might find none, and report a knee.
TEST(KneeTest, WrongAnswersEndASearch) {
  const Slo slo = *ParseSlo("p50=10ms");
  int runs = 0;
  const auto wrong_above = [&](double most) {
    return [&, most](double rate) {
      ++runs;
      Measurement measured;
      measured.all.requests = measured.all.answered = measured.all.answered_in_time = 100;
      measured.all.planned.Record(absl::Milliseconds(5), 100);
      measured.checked = 100;
      measured.wrong = rate > most ? 3 : 0;
      return JudgeTrial(rate, measured, slo);
    };
  };
  Knee knee;
  const absl::Status searched = FindKnee(100, wrong_above(150), &knee);
  EXPECT_TRUE(absl::IsDataLoss(searched)) << searched;
  EXPECT_EQ(searched.message(), "3 of 100 answers were wrong while the knee was searched");
  EXPECT_EQ(runs, 2);
  runs = 0;
  knee = {.rate = 1000};
  const absl::Status held = HoldKnee(&knee, wrong_above(950));
  EXPECT_TRUE(absl::IsDataLoss(held)) << held;
  EXPECT_EQ(runs, 1);
}

// A server that answers one request after the other, each in ten milliseconds, by a clock that the
// runs move on: whatever this machine can do, a hundred a second is the most.
TEST(KneeTest, TheKneeOfAServerIsWhatItCanDo) {
  // The clock stops with the run, which gives up on what it did not answer by then.
  const Slo slo = *ParseSlo("p90=250ms,errors=100%");
  const auto judge = [&](double rate, absl::Duration duration) {
    ManualClock clock;
    FakeTarget target(clock, absl::Milliseconds(10));
    clock.SetOnWait([&](absl::Time time) { target.AnswerUntil(time); });
    Recorder recorder(absl::Seconds(1));
    const RunPlan plan{
        .mode = Mode::kOpen, .rate = rate, .duration = duration, .drain = absl::ZeroDuration()};
    Driver driver(plan, clock, target, recorder,
                  [](uint64_t number) { return Work{.kind = Kind::kTiles, .item = number}; });
    EXPECT_TRUE(driver.Run().ok());
    return *JudgeTrial(rate, recorder.Result(driver.end()), slo);
  };
  Knee knee;
  const auto trial = [&](double rate) { return judge(rate, absl::Seconds(5)); };
  ASSERT_TRUE(FindKnee(7, trial, &knee).ok());
  ASSERT_TRUE(HoldKnee(&knee, [&](double rate) { return judge(rate, absl::Seconds(30)); }).ok());
  EXPECT_TRUE(knee.trials.back().held);
  EXPECT_NEAR(knee.rate, 100, 10);
  EXPECT_NEAR(knee.missed, 105, 10);
}

}  // namespace
}  // namespace sightline::load
