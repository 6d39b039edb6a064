// SPDX-License-Identifier: Apache-2.0
#include "client/cli/formats/npy.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <type_traits>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "client/cli/formats/file.h"
#include "core/base/check.h"

namespace sightline::cli {
namespace {

static_assert(std::endian::native == std::endian::little, "the writers write memory as it is");

constexpr absl::string_view kMagic("\x93NUMPY", 6);

absl::Status Bad(const std::string& name, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat("'", name, "': ", what));
}

// The header is a Python dictionary literal with three entries. This reads what numpy.save has ever
// written there: strings, True/False, a tuple of integers; anything else is refused.
class HeaderParser {
 public:
  explicit HeaderParser(absl::string_view text) : rest_(text) {}

  struct Header {
    std::string descr;
    bool fortran_order = false;
    std::vector<size_t> shape;
  };

  // nullopt when the text is not such a dictionary; error() then says why.
  std::optional<Header> Parse() {
    Header header;
    bool has_descr = false, has_order = false, has_shape = false;
    if (!Take('{')) return Fail("its header is no dictionary");
    while (!Take('}')) {
      std::optional<std::string> key = String();
      if (!key || !Take(':')) return Fail("its header is no dictionary");
      if (*key == "descr") {
        Skip();
        if (!rest_.empty() && rest_.front() == '[') {
          return Fail(
              "it holds records (a structured dtype); save its columns as one plain array, "
              "np.stack([a['x'], a['y'], a['z']], axis=1)");
        }
        std::optional<std::string> descr = String();
        if (!descr) return Fail("its header's 'descr' is no string");
        header.descr = *descr;
        has_descr = true;
      } else if (*key == "fortran_order") {
        if (TakeWord("True")) {
          header.fortran_order = true;
        } else if (!TakeWord("False")) {
          return Fail("its header's 'fortran_order' is neither True nor False");
        }
        has_order = true;
      } else if (*key == "shape") {
        if (!Shape(&header.shape)) return Fail("its header's 'shape' is no tuple of sizes");
        has_shape = true;
      } else {
        return Fail(absl::StrCat("its header has an unknown entry '", absl::CHexEscape(*key), "'"));
      }
      if (!Take(',') && Peek() != '}') return Fail("its header is no dictionary");
    }
    if (Peek() != '\0') return Fail("its header goes on after its dictionary");
    if (!has_descr || !has_order || !has_shape) {
      return Fail("its header lacks 'descr', 'fortran_order' or 'shape'");
    }
    return header;
  }
  const std::string& error() const { return error_; }

 private:
  std::nullopt_t Fail(absl::string_view what) {
    error_ = std::string(what);
    return std::nullopt;
  }
  void Skip() {
    while (!rest_.empty() && (rest_.front() == ' ' || rest_.front() == '\n' ||
                              rest_.front() == '\t' || rest_.front() == '\r')) {
      rest_.remove_prefix(1);
    }
  }
  char Peek() {
    Skip();
    return rest_.empty() ? '\0' : rest_.front();
  }
  bool Take(char c) {
    if (Peek() != c || rest_.empty()) return false;
    rest_.remove_prefix(1);
    return true;
  }
  bool TakeWord(absl::string_view word) {
    Skip();
    if (rest_.substr(0, word.size()) != word) return false;
    rest_.remove_prefix(word.size());
    return true;
  }
  std::optional<std::string> String() {
    const char quote = Peek();
    if (quote != '\'' && quote != '"') return std::nullopt;
    rest_.remove_prefix(1);
    const size_t end = rest_.find(quote);
    if (end == absl::string_view::npos) return std::nullopt;
    std::string text(rest_.substr(0, end));
    rest_.remove_prefix(end + 1);
    return text;
  }
  bool Shape(std::vector<size_t>* shape) {
    if (!Take('(')) return false;
    while (!Take(')')) {
      Skip();
      size_t digits = 0;
      while (digits < rest_.size() && absl::ascii_isdigit(rest_[digits])) ++digits;
      uint64_t size = 0;
      if (digits == 0 || !absl::SimpleAtoi(rest_.substr(0, digits), &size)) return false;
      rest_.remove_prefix(digits);
      Take('L');  // Python 2 wrote long integers so.
      shape->push_back(size);
      if (shape->size() > 32) return false;  // NumPy's own limit.
      if (!Take(',') && Peek() != ')') return false;
    }
    return true;
  }

  absl::string_view rest_;
  std::string error_;
};

uint64_t LoadBits(const char* p, size_t size, bool big_endian) {
  uint64_t bits = 0;
  for (size_t i = 0; i < size; ++i) {
    const auto byte = static_cast<unsigned char>(p[big_endian ? size - 1 - i : i]);
    bits |= uint64_t{byte} << (8 * i);
  }
  return bits;
}

double HalfToDouble(uint16_t bits) {
  const int exponent = (bits >> 10) & 31;
  const int fraction = bits & 1023;
  double value;
  if (exponent == 31) {
    value = fraction == 0 ? std::numeric_limits<double>::infinity()
                          : std::numeric_limits<double>::quiet_NaN();
  } else if (exponent == 0) {
    value = std::ldexp(fraction, -24);
  } else {
    value = std::ldexp(1024 + fraction, exponent - 25);
  }
  return (bits & 0x8000) != 0 ? -value : value;
}

// One element as a double; false if a double cannot hold it (integers beyond 2^53).
bool Convert(char kind, size_t size, uint64_t bits, double* value) {
  if (kind == 'f') {
    if (size == 8) {
      *value = std::bit_cast<double>(bits);
    } else if (size == 4) {
      *value = std::bit_cast<float>(static_cast<uint32_t>(bits));
    } else {
      *value = HalfToDouble(static_cast<uint16_t>(bits));
    }
    return true;
  }
  constexpr int64_t kExact = int64_t{1} << 53;
  if (kind == 'u') {
    *value = static_cast<double>(bits);
    return bits <= static_cast<uint64_t>(kExact);
  }
  // Sign extension by shifting the value to the top and back.
  const int shift = static_cast<int>(64 - 8 * size);
  const int64_t integer = static_cast<int64_t>(bits << shift) >> shift;
  *value = static_cast<double>(integer);
  return integer <= kExact && integer >= -kExact;
}

template <typename T>
constexpr absl::string_view Descr() {
  if constexpr (std::is_same_v<T, uint8_t>) return "|u1";
  if constexpr (std::is_same_v<T, int32_t>) return "<i4";
  if constexpr (std::is_same_v<T, int64_t>) return "<i8";
  if constexpr (std::is_same_v<T, float>) return "<f4";
  if constexpr (std::is_same_v<T, double>) return "<f8";
}

}  // namespace

std::string NpyShapeText(std::span<const size_t> shape) {
  std::string text = "(";
  for (size_t i = 0; i < shape.size(); ++i) {
    absl::StrAppend(&text, i == 0 ? "" : " ", shape[i], i + 1 < shape.size() || i == 0 ? "," : "");
  }
  return text + ")";
}

absl::StatusOr<NpyArray> ParseNpy(absl::string_view bytes, const std::string& name) {
  if (bytes.empty()) return Bad(name, "the file is empty");
  if (bytes.substr(0, kMagic.size()) != kMagic) {
    return Bad(name, "no .npy file (it does not start with \\x93NUMPY); write it with np.save");
  }
  if (bytes.size() < 10) return Bad(name, "the file ends within its header");
  const int version = static_cast<unsigned char>(bytes[6]);
  if (version < 1 || version > 3) {
    return Bad(name,
               absl::StrCat("version ", version, " of the .npy format is not known (1 to 3)"));
  }
  const size_t length_size = version == 1 ? 2 : 4;
  const size_t header_start = 8 + length_size;
  if (bytes.size() < header_start) return Bad(name, "the file ends within its header");
  const uint64_t header_size = LoadBits(bytes.data() + 8, length_size, /*big_endian=*/false);
  if (header_size > bytes.size() - header_start)
    return Bad(name, "the file ends within its header");
  // NumPy itself refuses headers beyond 10,000 bytes: a literal that long is no array's
  // description.
  constexpr uint64_t kMaxHeader = 10000;
  if (header_size > kMaxHeader) {
    return Bad(name, absl::StrCat("its header has ", header_size, " bytes; at most ", kMaxHeader,
                                  " make sense"));
  }
  HeaderParser parser(bytes.substr(header_start, header_size));
  const std::optional<HeaderParser::Header> header = parser.Parse();
  if (!header) return Bad(name, parser.error());

  NpyArray array;
  array.dtype = header->descr;
  array.shape = header->shape;
  const absl::string_view descr = header->descr;
  const bool known =
      descr.size() == 3 &&
      (descr[0] == '<' || descr[0] == '>' || descr[0] == '|' || descr[0] == '=') &&
      ((descr[1] == 'f' && (descr[2] == '2' || descr[2] == '4' || descr[2] == '8')) ||
       ((descr[1] == 'i' || descr[1] == 'u') &&
        (descr[2] == '1' || descr[2] == '2' || descr[2] == '4' || descr[2] == '8')));
  if (!known) {
    return Bad(name, absl::StrCat("dtype '", absl::CHexEscape(descr), "' with shape ",
                                  NpyShapeText(array.shape),
                                  " is neither a float of up to 8 bytes nor an integer; save it as "
                                  "np.save(file, a.astype(np.float64))"));
  }
  const size_t size = static_cast<size_t>(descr[2] - '0');
  size_t count = 1;
  bool empty = false;
  for (size_t n : array.shape) empty = empty || n == 0;
  if (empty) count = 0;
  const absl::string_view data = bytes.substr(header_start + header_size);
  for (size_t n : array.shape) {
    if (empty) break;
    if (n > data.size() / size / count) {
      return Bad(name, absl::StrCat("its header announces dtype '", descr, "' with shape ",
                                    NpyShapeText(array.shape), ", but only ", data.size(),
                                    " bytes of data follow; the file is cut short"));
    }
    count *= n;
  }
  if (data.size() < count * size) {  // A scalar without data.
    return Bad(name, "the file is cut short: no data follows its header");
  }
  if (data.size() != count * size) {
    return Bad(name, absl::StrCat("its header announces dtype '", descr, "' with shape ",
                                  NpyShapeText(array.shape), " (", count * size, " bytes), but ",
                                  data.size(), " bytes of data follow"));
  }

  array.values.resize(count);
  const bool big_endian = descr[0] == '>';
  // In C order a flat index is its own place; in Fortran order the first index runs fastest, so an
  // odometer over the shape with C strides finds the place of each value in turn.
  std::vector<size_t> strides(array.shape.size(), 1);
  for (size_t i = array.shape.size(); i-- > 1;) strides[i - 1] = strides[i] * array.shape[i];
  std::vector<size_t> index(array.shape.size(), 0);
  size_t place = 0;
  for (size_t i = 0; i < count; ++i) {
    const uint64_t bits = LoadBits(data.data() + i * size, size, big_endian);
    if (!Convert(descr[1], size, bits, &array.values[place])) {
      return Bad(name, absl::StrCat("the integer at flat position ", i, " (dtype '", descr,
                                    "') is beyond 2^53 and has no exact double"));
    }
    if (!header->fortran_order) {
      ++place;
      continue;
    }
    for (size_t d = 0; d < index.size(); ++d) {
      place += strides[d];
      if (++index[d] < array.shape[d]) break;
      place -= strides[d] * array.shape[d];
      index[d] = 0;
    }
  }
  return array;
}

absl::StatusOr<NpyArray> ReadNpy(const std::string& path, const CancelToken* cancel) {
  absl::StatusOr<std::string> bytes = ReadFile(path, cancel);
  if (!bytes.ok()) return bytes.status();
  return ParseNpy(*bytes, path);
}

namespace {

// All that stands before the values.
template <typename T>
std::string NpyHeader(std::span<const size_t> shape, size_t values) {
  size_t count = 1;
  for (size_t n : shape) count *= n;
  SIGHTLINE_CHECK(count == values);
  std::string header =
      absl::StrCat("{'descr': '", Descr<T>(),
                   "', 'fortran_order': False, 'shape': ", NpyShapeText(shape), ", }");
  // Blanks and a line end bring the data to a multiple of 64 bytes.
  const size_t unpadded = kMagic.size() + 4 + header.size() + 1;
  header.append((64 - unpadded % 64) % 64, ' ');
  header += '\n';
  std::string bytes(kMagic);
  bytes += '\x01';
  bytes += '\x00';
  bytes += static_cast<char>(header.size() & 255);
  bytes += static_cast<char>(header.size() >> 8);
  bytes += header;
  return bytes;
}

template <typename T>
absl::string_view BytesOf(std::span<const T> values) {
  return {reinterpret_cast<const char*>(values.data()), values.size_bytes()};
}

}  // namespace

template <typename T>
std::string FormatNpy(std::span<const size_t> shape, std::span<const T> values) {
  return absl::StrCat(NpyHeader<T>(shape, values.size()), BytesOf(values));
}

template <typename T>
absl::Status WriteNpy(const std::string& path, std::span<const size_t> shape,
                      std::span<const T> values) {
  const std::string header = NpyHeader<T>(shape, values.size());
  // The values as they lie there: they may fill half of the memory.
  const absl::string_view parts[] = {header, BytesOf(values)};
  return WriteFile(path, parts);
}

#define SIGHTLINE_NPY_TYPE(T)                                                     \
  template std::string FormatNpy<T>(std::span<const size_t>, std::span<const T>); \
  template absl::Status WriteNpy<T>(const std::string&, std::span<const size_t>,  \
                                    std::span<const T>);
SIGHTLINE_NPY_TYPE(uint8_t)
SIGHTLINE_NPY_TYPE(int32_t)
SIGHTLINE_NPY_TYPE(int64_t)
SIGHTLINE_NPY_TYPE(float)
SIGHTLINE_NPY_TYPE(double)
#undef SIGHTLINE_NPY_TYPE

}  // namespace sightline::cli
