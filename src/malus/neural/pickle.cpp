#include "malus/neural/pickle.h"

#include "malus/base/error.h"

#include <cstring>
#include <map>
#include <optional>

#include <fmt/format.h>

namespace malus {
namespace {

using Kind = PickleValue::Kind;

PicklePointer value_of(Kind kind) {
  auto value = std::make_shared<PickleValue>();
  value->kind = kind;
  return value;
}

std::optional<std::string> dtype_of(const std::string& name) {
  static const std::map<std::string, std::string> known = {
      {"torch FloatStorage", "F32"},     {"torch HalfStorage", "F16"},
      {"torch BFloat16Storage", "BF16"}, {"torch LongStorage", "I64"},
      {"torch DoubleStorage", "F64"},    {"torch IntStorage", "I32"},
      {"torch ByteStorage", "U8"},       {"torch BoolStorage", "U8"}};
  const auto found = known.find(name);
  if (found == known.end()) return std::nullopt;
  return found->second;
}

class Parser {
 public:
  Parser(std::span<const std::byte> bytes, std::string name)
      : bytes_(bytes), name_(std::move(name)) {}

  PicklePointer run() {
    while (true) {
      const auto code = byte();
      if (code == '.') return pop();
      if (!constant(code) && !container(code) && !memo(code)) special(code);
    }
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(name_, problem, "save the state dict again with torch.save");
  }
  std::span<const std::byte> take(std::uint64_t count) {
    if (count > bytes_.size() - at_) fail("is cut off");
    const auto part = bytes_.subspan(at_, static_cast<std::size_t>(count));
    at_ += static_cast<std::size_t>(count);
    return part;
  }
  unsigned char byte() { return static_cast<unsigned char>(take(1)[0]); }
  std::uint64_t little(int count) {
    std::uint64_t value = 0;
    const auto part = take(static_cast<std::uint64_t>(count));
    for (int i = count - 1; i >= 0; --i)
      value = value << 8 | static_cast<std::uint64_t>(part[static_cast<std::size_t>(i)]);
    return value;
  }
  std::string text(std::uint64_t count) {
    const auto part = take(count);
    return {reinterpret_cast<const char*>(part.data()), part.size()};
  }
  std::string line() {
    std::string out;
    for (char c = static_cast<char>(byte()); c != '\n'; c = static_cast<char>(byte())) out += c;
    return out;
  }

  void push(PicklePointer value) { stack_.push_back(std::move(value)); }
  void push_number(std::int64_t number) {
    push(value_of(Kind::kNumber));
    stack_.back()->number = number;
  }
  void push_text(std::string words, Kind kind = Kind::kText) {
    push(value_of(kind));
    stack_.back()->text = std::move(words);
  }
  PicklePointer pop() {
    if (stack_.empty()) fail("is no pickle of torch.save");
    auto value = std::move(stack_.back());
    stack_.pop_back();
    return value;
  }
  std::vector<PicklePointer> pop_marked() {
    if (marks_.empty() || marks_.back() > stack_.size()) fail("is no pickle of torch.save");
    const auto from = stack_.begin() + static_cast<std::ptrdiff_t>(marks_.back());
    std::vector<PicklePointer> items(from, stack_.end());
    stack_.erase(from, stack_.end());
    marks_.pop_back();
    return items;
  }
  void push_sequence(std::vector<PicklePointer> items) {
    push(value_of(Kind::kSequence));
    stack_.back()->items = std::move(items);
  }
  void push_last(std::size_t count) {
    std::vector<PicklePointer> items(count);
    for (std::size_t i = count; i-- > 0;) items[i] = pop();
    push_sequence(std::move(items));
  }
  PickleValue& top() {
    if (stack_.empty()) fail("is no pickle of torch.save");
    return *stack_.back();
  }

  bool constant(unsigned char code) {
    switch (code) {
      case 0x80:
        take(1);
        return true;  // PROTO
      case 0x95:
        take(8);
        return true;  // FRAME
      case 'N':
        push(value_of(Kind::kOther));
        return true;
      case 0x88:
        push_number(1);
        return true;
      case 0x89:
        push_number(0);
        return true;
      case 'J':
        push_number(static_cast<std::int32_t>(little(4)));
        return true;
      case 'K':
        push_number(static_cast<std::int64_t>(little(1)));
        return true;
      case 'M':
        push_number(static_cast<std::int64_t>(little(2)));
        return true;
      case 0x8a:
        push_long();
        return true;
      case 'G':
        take(8);
        push(value_of(Kind::kOther));
        return true;
      case 'X':
        push_text(text(little(4)));
        return true;
      case 0x8c:
        push_text(text(little(1)));
        return true;
      case 'B':
        push_text(text(little(4)));
        return true;
      case 'C':
        push_text(text(little(1)));
        return true;
      case 'c': {
        const std::string module = line();
        push_text(module + " " + line(), Kind::kName);
        return true;
      }
      case 0x93: {  // STACK_GLOBAL
        const auto name = pop(), module = pop();
        push_text(module->text + " " + name->text, Kind::kName);
        return true;
      }
      default:
        return false;
    }
  }
  // LONG1: little-endian two's complement of any length; longer ones than 8 bytes mean nothing
  // here.
  void push_long() {
    const int count = static_cast<int>(little(1));
    if (count > 8) {
      take(static_cast<std::uint64_t>(count));
      push(value_of(Kind::kOther));
      return;
    }
    std::uint64_t value = little(count);
    if (count > 0 && count < 8 && (value >> (8 * count - 1) & 1) != 0)
      value |= ~std::uint64_t{0} << (8 * count);
    push_number(static_cast<std::int64_t>(value));
  }

  bool container(unsigned char code) {
    switch (code) {
      case '(':
        marks_.push_back(stack_.size());
        return true;
      case ')':
        push_sequence({});
        return true;
      case ']':
        push_sequence({});
        return true;
      case '}':
        push(value_of(Kind::kTable));
        return true;
      case 0x8f:
        push_sequence({});
        return true;  // EMPTY_SET
      case 't':
      case 'l':
        push_sequence(pop_marked());
        return true;
      case 0x85:
        push_last(1);
        return true;
      case 0x86:
        push_last(2);
        return true;
      case 0x87:
        push_last(3);
        return true;
      case 'a': {
        auto item = pop();
        top().items.push_back(std::move(item));
        return true;
      }
      case 'e':
      case 0x90: {
        auto items = pop_marked();
        for (auto& item : items) top().items.push_back(std::move(item));
        return true;
      }
      case 's': {
        auto item = pop(), key = pop();
        top().table.emplace_back(std::move(key), std::move(item));
        return true;
      }
      case 'u': {
        const auto items = pop_marked();
        if (items.size() % 2 != 0) fail("is no pickle of torch.save");
        for (std::size_t i = 0; i < items.size(); i += 2)
          top().table.emplace_back(items[i], items[i + 1]);
        return true;
      }
      default:
        return false;
    }
  }

  bool memo(unsigned char code) {
    const auto get = [&](std::uint64_t number) {
      const auto found = memo_.find(number);
      if (found == memo_.end()) fail("is no pickle of torch.save");
      push(found->second);
      return true;
    };
    const auto put = [&](std::uint64_t number) {
      top();
      memo_[number] = stack_.back();
      return true;
    };
    switch (code) {
      case 'q':
        return put(little(1));
      case 'r':
        return put(little(4));
      case 0x94:
        return put(memo_.size());
      case 'h':
        return get(little(1));
      case 'j':
        return get(little(4));
      default:
        return false;
    }
  }

  void special(unsigned char code) {
    if (code == 'Q') return persistent();
    if (code == 'R' || code == 0x81) {  // REDUCE, NEWOBJ: a call, which is not made
      const auto arguments = pop(), function = pop();
      return push(result_of(*function, *arguments));
    }
    if (code == 'b') {  // BUILD: an object's attributes mean nothing here
      pop();
      top();
      return;
    }
    fail(fmt::format("holds what weights have no need of (code {:#x})", code));
  }
  // ("storage", type, key, device, elements)
  void persistent() {
    const auto id = pop();
    if (id->items.size() < 5 || id->items[0]->text != "storage") fail("is no pickle of torch.save");
    auto storage = value_of(Kind::kStorage);
    const auto dtype = dtype_of(id->items[1]->text);
    storage->storage = {dtype.value_or(""), id->items[2]->text};
    push(storage);
  }

  PicklePointer result_of(const PickleValue& function, const PickleValue& arguments) const {
    const auto& given = arguments.items;
    if (function.text == "collections OrderedDict") {
      auto table = value_of(Kind::kTable);
      if (!given.empty())
        for (const auto& pair : given[0]->items)
          if (pair->items.size() == 2) table->table.emplace_back(pair->items[0], pair->items[1]);
      return table;
    }
    if (function.text == "torch._utils _rebuild_parameter" && !given.empty()) return given[0];
    if (function.text == "torch._utils _rebuild_tensor_v2" && given.size() >= 4 &&
        given[0]->kind == Kind::kStorage) {
      auto tensor = value_of(Kind::kTensor);
      tensor->tensor.storage = given[0]->storage;
      tensor->tensor.offset = given[1]->number;
      for (const auto& size : given[2]->items) tensor->tensor.shape.push_back(size->number);
      for (const auto& step : given[3]->items) tensor->tensor.stride.push_back(step->number);
      return tensor;
    }
    return value_of(Kind::kOther);
  }

  std::span<const std::byte> bytes_;
  std::string name_;
  std::size_t at_ = 0;
  std::vector<PicklePointer> stack_;
  std::vector<std::size_t> marks_;
  std::map<std::uint64_t, PicklePointer> memo_;
};

}  // namespace

PicklePointer parse_pickle(std::span<const std::byte> bytes, const std::string& name) {
  return Parser(bytes, name).run();
}

}  // namespace malus
