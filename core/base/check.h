// SPDX-License-Identifier: Apache-2.0
//
// Checks of our own invariants: a failed one is a bug of ours, never bad input (that is an
// absl::Status). It prints file, line, the condition, the values and the message on stderr, then
// aborts.
//
//   SIGHTLINE_CHECK(node.count > 0) << "leaf " << i << " is empty";
//   SIGHTLINE_CHECK_LE(first + count, triangles.size());
//   SIGHTLINE_DCHECK(box.Contains(p));     // REQUIRES: lines; in debug and sanitizer builds only.
//
// SIGHTLINE_CHECK stays on in release builds. SIGHTLINE_DCHECK does not evaluate its condition
// there, but compiles it.
//
// Thread safety: usable from any thread; the line is written in one piece.
#ifndef SIGHTLINE_CORE_BASE_CHECK_H_
#define SIGHTLINE_CORE_BASE_CHECK_H_

#include <memory>
#include <ostream>
#include <sstream>
#include <string>
#include <type_traits>

namespace sightline::check_internal {

// Collects the message; its destructor prints and aborts.
class Failure {
 public:
  Failure(const char* file, int line, const std::string& condition);
  Failure(const Failure&) = delete;
  Failure& operator=(const Failure&) = delete;
  [[noreturn]] ~Failure();
  std::ostream& stream() { return stream_; }

 private:
  std::ostringstream stream_;
};

// Makes both arms of the macro's ?: void, with a precedence below << and above ?:.
struct Voidify {
  void operator&(std::ostream&) const {}
};

template <typename T>
void Print(std::ostream& out, const T& value) {
  if constexpr (std::is_same_v<T, char> || std::is_same_v<T, signed char> ||
                std::is_same_v<T, unsigned char>) {
    out << static_cast<int>(value);
  } else if constexpr (std::is_enum_v<T>) {
    Print(out, static_cast<std::underlying_type_t<T>>(value));
  } else if constexpr (std::is_null_pointer_v<T>) {
    out << "nullptr";
  } else if constexpr (requires { out << value; }) {
    out << value;
  } else {
    out << "(" << sizeof(T) << " bytes)";
  }
}

template <typename A, typename B>
__attribute__((noinline, cold)) std::unique_ptr<std::string> Describe(const A& a, const B& b,
                                                                      const char* condition) {
  std::ostringstream out;
  out << condition << " (";
  Print(out, a);
  out << " against ";
  Print(out, b);
  out << ")";
  return std::make_unique<std::string>(out.str());
}

#define SIGHTLINE_INTERNAL_DEFINE_CHECK(name, op)                                           \
  template <typename A, typename B>                                                         \
  inline std::unique_ptr<std::string> name(const A& a, const B& b, const char* condition) { \
    if (__builtin_expect(static_cast<bool>(a op b), true)) return nullptr;                  \
    return Describe(a, b, condition);                                                       \
  }
SIGHTLINE_INTERNAL_DEFINE_CHECK(Eq, ==)
SIGHTLINE_INTERNAL_DEFINE_CHECK(Ne, !=)
SIGHTLINE_INTERNAL_DEFINE_CHECK(Lt, <)
SIGHTLINE_INTERNAL_DEFINE_CHECK(Le, <=)
SIGHTLINE_INTERNAL_DEFINE_CHECK(Gt, >)
SIGHTLINE_INTERNAL_DEFINE_CHECK(Ge, >=)
#undef SIGHTLINE_INTERNAL_DEFINE_CHECK

}  // namespace sightline::check_internal

#define SIGHTLINE_CHECK(condition)                     \
  __builtin_expect(static_cast<bool>(condition), true) \
      ? (void)0                                        \
      : ::sightline::check_internal::Voidify() &       \
            ::sightline::check_internal::Failure(__FILE__, __LINE__, #condition).stream()

// `while`, not `if`: it needs no else, so that the macro is safe within an unbraced if-else.
#define SIGHTLINE_INTERNAL_CHECK_OP(name, op, a, b)                          \
  while (auto sightline_check_text =                                         \
             ::sightline::check_internal::name((a), (b), #a " " #op " " #b)) \
  ::sightline::check_internal::Failure(__FILE__, __LINE__, *sightline_check_text).stream()

#define SIGHTLINE_CHECK_EQ(a, b) SIGHTLINE_INTERNAL_CHECK_OP(Eq, ==, a, b)
#define SIGHTLINE_CHECK_NE(a, b) SIGHTLINE_INTERNAL_CHECK_OP(Ne, !=, a, b)
#define SIGHTLINE_CHECK_LT(a, b) SIGHTLINE_INTERNAL_CHECK_OP(Lt, <, a, b)
#define SIGHTLINE_CHECK_LE(a, b) SIGHTLINE_INTERNAL_CHECK_OP(Le, <=, a, b)
#define SIGHTLINE_CHECK_GT(a, b) SIGHTLINE_INTERNAL_CHECK_OP(Gt, >, a, b)
#define SIGHTLINE_CHECK_GE(a, b) SIGHTLINE_INTERNAL_CHECK_OP(Ge, >=, a, b)

// SIGHTLINE_DEBUG_CHECKS comes from the build: on for Debug and for every sanitizer.
#if defined(SIGHTLINE_DEBUG_CHECKS)
#define SIGHTLINE_DCHECK(condition) SIGHTLINE_CHECK(condition)
#define SIGHTLINE_DCHECK_EQ(a, b) SIGHTLINE_CHECK_EQ(a, b)
#define SIGHTLINE_DCHECK_NE(a, b) SIGHTLINE_CHECK_NE(a, b)
#define SIGHTLINE_DCHECK_LT(a, b) SIGHTLINE_CHECK_LT(a, b)
#define SIGHTLINE_DCHECK_LE(a, b) SIGHTLINE_CHECK_LE(a, b)
#define SIGHTLINE_DCHECK_GT(a, b) SIGHTLINE_CHECK_GT(a, b)
#define SIGHTLINE_DCHECK_GE(a, b) SIGHTLINE_CHECK_GE(a, b)
#else
#define SIGHTLINE_DCHECK(condition) SIGHTLINE_CHECK(true || (condition))
#define SIGHTLINE_DCHECK_EQ(a, b) SIGHTLINE_DCHECK((a) == (b))
#define SIGHTLINE_DCHECK_NE(a, b) SIGHTLINE_DCHECK((a) != (b))
#define SIGHTLINE_DCHECK_LT(a, b) SIGHTLINE_DCHECK((a) < (b))
#define SIGHTLINE_DCHECK_LE(a, b) SIGHTLINE_DCHECK((a) <= (b))
#define SIGHTLINE_DCHECK_GT(a, b) SIGHTLINE_DCHECK((a) > (b))
#define SIGHTLINE_DCHECK_GE(a, b) SIGHTLINE_DCHECK((a) >= (b))
#endif

#endif  // SIGHTLINE_CORE_BASE_CHECK_H_
