// SPDX-License-Identifier: Apache-2.0
//
// Walks the descriptors of sightline/v1, comments included: everything is commented, and names keep
// to Google's API guidelines (the AIP numbers stand beside the rules).
#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>

#include <fstream>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::DescriptorPool;
using google::protobuf::EnumDescriptor;
using google::protobuf::EnumValueDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;
using google::protobuf::MethodDescriptor;
using google::protobuf::ServiceDescriptor;
using google::protobuf::SourceLocation;

bool IsUpperCamel(absl::string_view name) {
  return !name.empty() && absl::ascii_isupper(name[0]) && !absl::StrContains(name, "_");
}

bool IsLowerSnake(absl::string_view name) {
  for (const char c : name) {
    if (!absl::ascii_islower(c) && !absl::ascii_isdigit(c) && c != '_') return false;
  }
  return !name.empty() && absl::ascii_islower(name[0]) && !absl::StrContains(name, "__");
}

// BuildPreset -> BUILD_PRESET_
std::string EnumPrefix(absl::string_view name) {
  std::string prefix;
  for (const char c : name) {
    if (absl::ascii_isupper(c) && !prefix.empty()) prefix += '_';
    prefix += absl::ascii_toupper(c);
  }
  return prefix + "_";
}

class DescriptorTest : public testing::Test {
 protected:
  void SetUp() override {
    std::ifstream file(SIGHTLINE_DESCRIPTOR_SET, std::ios::binary);
    google::protobuf::FileDescriptorSet set;
    ASSERT_TRUE(set.ParseFromIstream(&file)) << SIGHTLINE_DESCRIPTOR_SET;
    for (const auto& proto : set.file()) {
      const FileDescriptor* built = pool_.BuildFile(proto);
      ASSERT_NE(built, nullptr) << proto.name();
      if (built->package() == "sightline.v1") files_.push_back(built);
    }
    ASSERT_EQ(files_.size(), 7u);
  }

  void ForEachMessage(const std::function<void(const Descriptor&)>& visit) const {
    const std::function<void(const Descriptor&)> deep = [&](const Descriptor& message) {
      if (message.options().map_entry()) return;
      visit(message);
      for (int i = 0; i < message.nested_type_count(); ++i) deep(*message.nested_type(i));
    };
    for (const FileDescriptor* file : files_) {
      for (int i = 0; i < file->message_type_count(); ++i) deep(*file->message_type(i));
    }
  }
  void ForEachEnum(const std::function<void(const EnumDescriptor&)>& visit) const {
    for (const FileDescriptor* file : files_) {
      for (int i = 0; i < file->enum_type_count(); ++i) visit(*file->enum_type(i));
    }
    ForEachMessage([&](const Descriptor& message) {
      for (int i = 0; i < message.enum_type_count(); ++i) visit(*message.enum_type(i));
    });
  }
  void ForEachMethod(const std::function<void(const MethodDescriptor&)>& visit) const {
    for (const FileDescriptor* file : files_) {
      for (int s = 0; s < file->service_count(); ++s) {
        for (int m = 0; m < file->service(s)->method_count(); ++m)
          visit(*file->service(s)->method(m));
      }
    }
  }

  DescriptorPool pool_;
  std::vector<const FileDescriptor*> files_;
};

template <typename Element>
std::string Comment(const Element& element) {
  SourceLocation location;
  if (!element.GetSourceLocation(&location)) return "";
  return std::string(absl::StripAsciiWhitespace(location.leading_comments));
}

// A comment says something: more than a word, and a whole sentence.
template <typename Element>
void ExpectCommented(const Element& element) {
  const std::string comment = Comment(element);
  EXPECT_GT(comment.size(), 10u) << element.full_name() << " has no comment";
  const bool sentence =
      absl::EndsWith(comment, ".") || absl::EndsWith(comment, "?") || absl::EndsWith(comment, ".)");
  EXPECT_TRUE(sentence) << element.full_name() << ": \"" << comment << "\" is no sentence";
  for (const absl::string_view mark : {"TODO", "FIXME", "XXX"}) {
    EXPECT_FALSE(absl::StrContains(comment, mark)) << element.full_name();
  }
}

TEST_F(DescriptorTest, EveryElementIsCommented) {
  int elements = 0;
  const auto check = [&](const auto& element) {
    ExpectCommented(element);
    ++elements;
  };
  ForEachMessage([&](const Descriptor& message) {
    check(message);
    for (int i = 0; i < message.field_count(); ++i) check(*message.field(i));
    for (int i = 0; i < message.real_oneof_decl_count(); ++i) check(*message.oneof_decl(i));
  });
  ForEachEnum([&](const EnumDescriptor& type) {
    check(type);
    for (int i = 0; i < type.value_count(); ++i) check(*type.value(i));
  });
  ForEachMethod([&](const MethodDescriptor& method) { check(method); });
  for (const FileDescriptor* file : files_) {
    for (int i = 0; i < file->service_count(); ++i) check(*file->service(i));
  }
  EXPECT_GT(elements, 300);
}

// A byte array without its element type and shape is a riddle.
TEST_F(DescriptorTest, EveryByteArrayStatesItsShape) {
  int arrays = 0;
  ForEachMessage([&](const Descriptor& message) {
    for (int i = 0; i < message.field_count(); ++i) {
      const FieldDescriptor& field = *message.field(i);
      if (field.type() != FieldDescriptor::TYPE_BYTES) continue;
      ++arrays;
      const std::string comment = Comment(field);
      const bool type =
          absl::StrContains(comment, "float32") || absl::StrContains(comment, "float64") ||
          absl::StrContains(comment, "uint32") || absl::StrContains(comment, "uint8") ||
          absl::StrContains(comment, "Bit [") || absl::StrContains(comment, "v, ");
      EXPECT_TRUE(type) << field.full_name() << ": " << comment;
      EXPECT_TRUE(absl::StrContains(comment, "[") || absl::StrContains(comment, "as above") ||
                  absl::StrContains(comment, "Layout of"))
          << field.full_name() << ": " << comment;
    }
  });
  EXPECT_GT(arrays, 20);
}

// AIP-191: the folder is the package, one service per file, named after it.
TEST_F(DescriptorTest, FilesAreThePackage) {
  for (const FileDescriptor* file : files_) {
    EXPECT_TRUE(absl::StartsWith(file->name(), "sightline/v1/")) << file->name();
    EXPECT_LE(file->service_count(), 1) << file->name();
    if (file->service_count() == 1) {
      const std::string expected = absl::StrCat(
          "sightline/v1/",
          absl::AsciiStrToLower(absl::StripSuffix(EnumPrefix(file->service(0)->name()), "_")),
          ".proto");
      EXPECT_EQ(file->name(), expected);
      EXPECT_TRUE(absl::EndsWith(file->service(0)->name(), "Service"));
    }
  }
}

// AIP-140, AIP-190.
TEST_F(DescriptorTest, NamesHaveTheirCase) {
  ForEachMessage([&](const Descriptor& message) {
    EXPECT_TRUE(IsUpperCamel(message.name())) << message.full_name();
    for (int i = 0; i < message.field_count(); ++i) {
      EXPECT_TRUE(IsLowerSnake(message.field(i)->name())) << message.field(i)->full_name();
    }
  });
  ForEachMethod([&](const MethodDescriptor& method) {
    EXPECT_TRUE(IsUpperCamel(method.name())) << method.full_name();
  });
}

// AIP-126: the zero value is unspecified; values carry the enum's name.
TEST_F(DescriptorTest, EnumsStartUnspecified) {
  int enums = 0;
  ForEachEnum([&](const EnumDescriptor& type) {
    ++enums;
    const std::string prefix = EnumPrefix(type.name());
    const EnumValueDescriptor* zero = type.FindValueByNumber(0);
    ASSERT_NE(zero, nullptr) << type.full_name();
    EXPECT_EQ(zero->name(), absl::StrCat(prefix, "UNSPECIFIED"));
    for (int i = 0; i < type.value_count(); ++i) {
      EXPECT_TRUE(absl::StartsWith(type.value(i)->name(), prefix)) << type.value(i)->full_name();
    }
  });
  EXPECT_GE(enums, 6);
}

// AIP-131 to 135: request messages of the standard methods, and what they are called.
TEST_F(DescriptorTest, StandardMethodsHaveStandardShapes) {
  std::set<std::string> seen;
  ForEachMethod([&](const MethodDescriptor& method) {
    const std::string& name = method.name();
    const Descriptor& request = *method.input_type();
    EXPECT_EQ(request.name(), absl::StrCat(name, "Request")) << method.full_name();
    if (absl::StartsWith(name, "Get") && name != "GetCapabilities") {
      seen.insert("Get");
      EXPECT_NE(request.FindFieldByName("name"), nullptr) << name;
      EXPECT_EQ(method.output_type()->name(), name.substr(3));
    } else if (absl::StartsWith(name, "List")) {
      seen.insert("List");
      ASSERT_NE(request.FindFieldByName("page_size"), nullptr) << name;
      EXPECT_EQ(request.FindFieldByName("page_size")->type(), FieldDescriptor::TYPE_INT32);
      ASSERT_NE(request.FindFieldByName("page_token"), nullptr) << name;
      EXPECT_EQ(method.output_type()->name(), absl::StrCat(name, "Response"));
      EXPECT_NE(method.output_type()->FindFieldByName("next_page_token"), nullptr) << name;
      ASSERT_GT(method.output_type()->field_count(), 0);
      EXPECT_TRUE(method.output_type()->FindFieldByNumber(1)->is_repeated()) << name;
    } else if (absl::StartsWith(name, "Create")) {
      seen.insert("Create");
      EXPECT_EQ(method.output_type()->name(), name.substr(6));
      const FieldDescriptor* header = request.FindFieldByName("header");
      ASSERT_NE(header, nullptr) << name;
      EXPECT_NE(header->message_type()->FindFieldByName("request_id"), nullptr) << name;  // AIP-155
    } else if (absl::StartsWith(name, "Delete")) {
      seen.insert("Delete");
      EXPECT_NE(request.FindFieldByName("name"), nullptr) << name;
      EXPECT_EQ(method.output_type()->full_name(), "google.protobuf.Empty");
    }
  });
  EXPECT_THAT(seen, testing::ElementsAre("Create", "Delete", "Get", "List"));
}

// AIP-141, 142: counts end in _count, instants in _time, spans in _duration or are named otherwise
// but typed.
TEST_F(DescriptorTest, QuantitiesAreNamedByKind) {
  ForEachMessage([&](const Descriptor& message) {
    for (int i = 0; i < message.field_count(); ++i) {
      const FieldDescriptor& field = *message.field(i);
      const std::string name(field.name());
      EXPECT_FALSE(absl::StartsWith(name, "num_")) << field.full_name();
      if (field.message_type() == nullptr) continue;
      if (field.message_type()->full_name() == "google.protobuf.Timestamp") {
        EXPECT_TRUE(absl::EndsWith(name, "_time")) << field.full_name();
      }
      if (absl::EndsWith(name, "_duration")) {
        EXPECT_EQ(field.message_type()->full_name(), "google.protobuf.Duration");
      }
    }
  });
}

// The three streams of queries are bidirectional and share their first words.
TEST_F(DescriptorTest, QueriesAreBidirectionalStreams) {
  std::set<std::string> streams;
  ForEachMethod([&](const MethodDescriptor& method) {
    if (method.service()->name() != "VisibilityService") return;
    EXPECT_TRUE(method.client_streaming() && method.server_streaming()) << method.full_name();
    streams.insert(std::string(method.name()));
    for (const char* part : {"header", "item", "cancel", "grant_result_credit"}) {
      EXPECT_NE(method.input_type()->FindFieldByName(part), nullptr) << method.full_name() << part;
    }
    for (const char* part : {"opened", "reply", "draining"}) {
      EXPECT_NE(method.output_type()->FindFieldByName(part), nullptr) << method.full_name() << part;
    }
  });
  EXPECT_THAT(streams, testing::ElementsAre("ComputeShadows", "TestSegments", "TraceTiles"));
}

}  // namespace
}  // namespace sightline
