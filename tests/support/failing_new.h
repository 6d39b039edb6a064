// SPDX-License-Identifier: Apache-2.0
//
// Memory that runs out at a chosen allocation of the calling thread, and how much was held at once.
// A program that is linked with sightline_test_failing_new has its plain operator new replaced; one
// that is over-aligned is not.
//
// Thread safety: each thread has its own count of allocations; what is held is that of all threads.
//
//   FailingNew fault(3);  // The fourth allocation from here on throws std::bad_alloc, once.
//   Run();
//   if (!fault.met()) ...  // It took fewer.
#ifndef SIGHTLINE_TESTS_SUPPORT_FAILING_NEW_H_
#define SIGHTLINE_TESTS_SUPPORT_FAILING_NEW_H_

#include <cstdint>

namespace sightline::testing_support {

class FailingNew {
 public:
  explicit FailingNew(int allocations_before);
  ~FailingNew();
  FailingNew(const FailingNew&) = delete;
  FailingNew& operator=(const FailingNew&) = delete;

  bool met() const;
};

// The most that was held at once by operator new, beyond what was held when this was made.
class HeldByNew {
 public:
  HeldByNew();
  int64_t most() const;

 private:
  const int64_t before_;
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_FAILING_NEW_H_
