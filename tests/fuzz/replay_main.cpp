// Runs a fuzz target without a fuzzer and with any compiler, over stored inputs and over variations
// of them that repeat: `replay_calls [--vary N] FILE...`; of a folder all files are taken. What
// aborts is the input named last, or its variation named last; a variation is written to the file
// 'finding' in the working directory before it runs.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, size_t size);

namespace {

namespace fs = std::filesystem;

const char* const kNumbers[] = {"0", "-1", "1e-300", "1e300", "1e-9", "0.5", "3", "null", "\"a\""};

std::vector<std::string> find_inputs(int count, char** names) {
  std::vector<std::string> inputs;
  for (int i = 0; i < count; ++i) {
    if (!fs::is_directory(names[i])) {
      inputs.push_back(names[i]);
      continue;
    }
    for (const fs::directory_entry& entry : fs::directory_iterator(names[i])) {
      if (entry.is_regular_file()) inputs.push_back(entry.path().string());
    }
  }
  std::sort(inputs.begin(), inputs.end());
  return inputs;
}

/// The same with one to four changes: a byte, a part left out, doubled or taken from elsewhere, or
/// a number replaced.
std::string vary(std::string bytes, const std::string& other, std::mt19937_64& random) {
  const auto draw = [&](size_t end) { return end ? static_cast<size_t>(random() % end) : 0; };
  for (size_t changes = 1 + draw(4); changes > 0; --changes) {
    const size_t at = draw(bytes.size()), length = 1 + draw(16);
    switch (draw(5)) {
      case 0:
        if (!bytes.empty()) bytes[at] = static_cast<char>(random());
        break;
      case 1:
        bytes.erase(at, length);
        break;
      case 2:
        bytes.insert(at, bytes.substr(at, length));
        break;
      case 3:
        bytes.insert(at, other.substr(draw(other.size()), length));
        break;
      default: {
        const size_t first = bytes.find_first_of("0123456789", at);
        if (first == std::string::npos) break;
        const size_t last =
            std::min(bytes.find_first_not_of("0123456789.eE+-", first), bytes.size());
        bytes.replace(first, last - first, kNumbers[draw(std::size(kNumbers))]);
      }
    }
  }
  return bytes;
}

/// @return whether the target kept its promises; prints why not
bool run(const std::string& bytes) {
  try {
    LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
    return true;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "FINDING: an exception leaves the target: %s\n", error.what());
    return false;
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool varies = argc > 2 && std::string(argv[1]) == "--vary";
  const int variations = varies ? std::atoi(argv[2]) : 0, skipped = varies ? 3 : 1;
  std::vector<std::string> names = find_inputs(argc - skipped, argv + skipped), inputs;
  for (const std::string& name : names) {
    std::ifstream file(name, std::ios::binary);
    inputs.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
    if (!file) {
      std::fprintf(stderr, "%s: cannot be read\n", name.c_str());
      return 1;
    }
  }
  std::mt19937_64 random(1);
  for (size_t i = 0; i < inputs.size(); ++i) {
    std::printf("%s\n", names[i].c_str());
    std::fflush(stdout);
    if (!run(inputs[i])) return 1;
    for (int k = 0; k < variations; ++k) {
      const std::string bytes = vary(inputs[i], inputs[random() % inputs.size()], random);
      std::ofstream("finding", std::ios::binary) << bytes;
      if (!run(bytes)) return 1;
    }
  }
  if (variations > 0) fs::remove("finding");
  std::printf("%zu inputs, each as it is and in %d variations\n", inputs.size(), variations);
  return inputs.empty() ? 1 : 0;
}
