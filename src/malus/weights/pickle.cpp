#include "malus/weights/internal/pickle.h"

#include "malus/base/error.h"
#include "malus/weights/safetensors.h"

#include <map>

#include <fmt/format.h>

namespace malus {
namespace {

using Kind = PickleValue::Kind;

// A state dict of 1000 weights has about 30,000 values, its optimizer's three times as many.
constexpr std::size_t kMostValues = 1 << 20;
constexpr std::size_t kMostPushes = 4 * kMostValues;  // values that are taken again count too
constexpr std::size_t kLongestGlobal = 256;

// "" for types that weights do not have.
std::string dtype_of(const std::string& name) {
  static const std::map<std::string, std::string> known = {
      {"torch FloatStorage", "F32"},     {"torch HalfStorage", "F16"},
      {"torch BFloat16Storage", "BF16"}, {"torch LongStorage", "I64"},
      {"torch DoubleStorage", "F64"},    {"torch IntStorage", "I32"},
      {"torch ByteStorage", "U8"},       {"torch BoolStorage", "U8"}};
  const auto found = known.find(name);
  return found == known.end() ? "" : found->second;
}

class Parser {
 public:
  Parser(std::span<const std::byte> bytes, std::string name)
      : bytes_(bytes), name_(std::move(name)) {}

  Pickle run() {
    for (auto code = byte(); code != '.'; code = byte())
      if (!number(code) && !words(code) && !container(code) && !memo(code)) special(code);
    pickle_.root = pop();
    return std::move(pickle_);
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

  PickleValue* made(Kind kind) {
    if (pickle_.values.size() == kMostValues)
      fail(fmt::format("holds more than {} values", kMostValues));
    pickle_.values.emplace_back().kind = kind;
    return &pickle_.values.back();
  }
  void push(PickleValue* value) {
    if (++pushes_ > kMostPushes) fail(fmt::format("names values more than {} times", kMostPushes));
    stack_.push_back(value);
  }
  void push_number(std::int64_t value) {
    push(made(Kind::kNumber));
    stack_.back()->number = value;
  }
  void push_text(std::string text, Kind kind = Kind::kText) {
    push(made(kind));
    stack_.back()->text = std::move(text);
  }
  // Texts may be taken from the memo again and again, so their sums must not grow with them.
  void push_name(const std::string& module, const std::string& name) {
    if (module.size() + name.size() > kLongestGlobal) fail("holds a name without end");
    push_text(module + " " + name, Kind::kName);
  }
  PickleValue* pop() {
    if (stack_.empty()) fail("is no pickle of torch.save");
    PickleValue* value = stack_.back();
    stack_.pop_back();
    return value;
  }
  std::vector<PickleValue*> pop_marked() {
    if (marks_.empty() || marks_.back() > stack_.size()) fail("is no pickle of torch.save");
    const auto from = stack_.begin() + static_cast<std::ptrdiff_t>(marks_.back());
    std::vector<PickleValue*> items(from, stack_.end());
    stack_.erase(from, stack_.end());
    marks_.pop_back();
    return items;
  }
  void push_sequence(std::vector<PickleValue*> items) {
    push(made(Kind::kSequence));
    stack_.back()->items = std::move(items);
  }
  void push_last(std::size_t count) {
    std::vector<PickleValue*> items(count);
    for (std::size_t i = count; i-- > 0;) items[i] = pop();
    push_sequence(std::move(items));
  }
  PickleValue& top() {
    if (stack_.empty()) fail("is no pickle of torch.save");
    return *stack_.back();
  }

  bool number(unsigned char code) {
    switch (code) {
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
        push(made(Kind::kOther));
        return true;
      case 'N':
        push(made(Kind::kOther));
        return true;
      case 0x80:  // PROTO
        take(1);
        return true;
      case 0x95:  // FRAME
        take(8);
        return true;
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
      push(made(Kind::kOther));
      return;
    }
    std::uint64_t value = little(count);
    if (count > 0 && count < 8 && (value >> (8 * count - 1) & 1) != 0)
      value |= ~std::uint64_t{0} << (8 * count);
    push_number(static_cast<std::int64_t>(value));
  }

  bool words(unsigned char code) {
    switch (code) {
      case 'X':
      case 'B':
        push_text(text(little(4)));
        return true;
      case 0x8c:
      case 'C':
        push_text(text(little(1)));
        return true;
      case 'c': {
        const std::string module = line();
        push_name(module, line());
        return true;
      }
      case 0x93: {  // STACK_GLOBAL
        const PickleValue *name = pop(), *module = pop();
        push_name(module->text, name->text);
        return true;
      }
      default:
        return false;
    }
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
        push(made(Kind::kTable));
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
        PickleValue* item = pop();
        top().items.push_back(item);
        return true;
      }
      case 'e':
      case 0x90: {
        const auto items = pop_marked();
        auto& list = top().items;
        list.insert(list.end(), items.begin(), items.end());
        return true;
      }
      case 's': {
        PickleValue *item = pop(), *key = pop();
        top().table.emplace_back(key, item);
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
      const PickleValue *arguments = pop(), *function = pop();
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
    const PickleValue* id = pop();
    if (id->items.size() < 5 || id->items[0]->text != "storage" ||
        id->items[2]->text.size() > kLongestGlobal)
      fail("is no pickle of torch.save");
    push(made(Kind::kStorage));
    stack_.back()->tensor.dtype = dtype_of(id->items[1]->text);
    stack_.back()->tensor.key = id->items[2]->text;
  }

  PickleValue* result_of(const PickleValue& function, const PickleValue& arguments) {
    const auto& given = arguments.items;
    if (function.text == "collections OrderedDict") return table_of(given);
    if (function.text == "torch._utils _rebuild_parameter" && !given.empty()) return given[0];
    if (function.text == "torch._utils _rebuild_tensor_v2" && given.size() >= 4 &&
        given[0]->kind == Kind::kStorage)
      return tensor_of(given);
    return made(Kind::kOther);
  }
  // OrderedDict(pairs): the pairs may come from the memo again and again, so their number is
  // limited by what the file could have said in full.
  PickleValue* table_of(const std::vector<PickleValue*>& given) {
    PickleValue* table = made(Kind::kTable);
    if (given.empty()) return table;
    copied_ += given[0]->items.size();
    if (copied_ > bytes_.size()) fail("repeats its tables without end");
    for (const PickleValue* pair : given[0]->items)
      if (pair->items.size() == 2) table->table.emplace_back(pair->items[0], pair->items[1]);
    return table;
  }
  PickleValue* tensor_of(const std::vector<PickleValue*>& given) {
    if (given[2]->items.size() > kMostDimensions ||
        given[3]->items.size() != given[2]->items.size())
      fail("holds a tensor without a proper shape");
    constexpr std::size_t kMetadata = 6;  // {"neg": true} and the like: views that change values
    if (given.size() > kMetadata && !given[kMetadata]->table.empty())
      fail("holds a tensor that is a negated or conjugated view; save a copy of it");
    PickleValue* value = made(Kind::kTensor);
    PickleTensor& tensor = value->tensor;
    tensor.dtype = given[0]->tensor.dtype;
    tensor.key = given[0]->tensor.key;
    tensor.offset = given[1]->number;
    for (const PickleValue* size : given[2]->items) tensor.shape.push_back(size->number);
    for (const PickleValue* step : given[3]->items) tensor.stride.push_back(step->number);
    return value;
  }

  std::span<const std::byte> bytes_;
  std::string name_;
  std::size_t at_ = 0, copied_ = 0, pushes_ = 0;
  Pickle pickle_;
  std::vector<PickleValue*> stack_;
  std::vector<std::size_t> marks_;
  std::map<std::uint64_t, PickleValue*> memo_;
};

}  // namespace

Pickle parse_pickle(std::span<const std::byte> bytes, const std::string& name) {
  return Parser(bytes, name).run();
}

}  // namespace malus
