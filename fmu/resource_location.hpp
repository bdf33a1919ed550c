// From the resource location of an importer to a folder name.
//
// The standard requires a file URI and allows file:///abs and file:/abs; importers also pass
// file://localhost/abs, Windows drives in several spellings, percent-encoded or not, and plain
// paths. These functions do not access the file system.
#pragma once

#include <algorithm>
#include <cctype>
#include <stdexcept>
#include <string>

namespace dockloop {

/// Text with %41 replaced by A. A % without two hex digits is kept: some importers do not encode.
inline std::string percent_decode(const std::string& text) {
  const auto digit = [](char c) {
    return std::isdigit(static_cast<unsigned char>(c)) ? c - '0' : (c | 0x20) - 'a' + 10;
  };
  const auto is_hex = [](char c) { return std::isxdigit(static_cast<unsigned char>(c)) != 0; };
  std::string out;
  for (size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%' && i + 2 < text.size() && is_hex(text[i + 1]) && is_hex(text[i + 2])) {
      out += static_cast<char>(16 * digit(text[i + 1]) + digit(text[i + 2]));
      i += 2;
    } else {
      out += text[i];
    }
  }
  return out;
}

/// Folder of a resource location, without a slash at its end.
/// @throws std::invalid_argument with a sentence that contains the location.
inline std::string resource_folder(const std::string& location) {
  const auto refuse = [&](const std::string& why) {
    throw std::invalid_argument("fmuResourceLocation '" + location + "' " + why);
  };
  const auto lower = [](std::string text) {
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return text;
  };
  const auto is_drive = [](const std::string& text, size_t at) {
    return text.size() >= at + 2 && std::isalpha(static_cast<unsigned char>(text[at])) &&
           (text[at + 1] == ':' || text[at + 1] == '|');
  };
  if (location.empty()) refuse("is empty: a file URI of the folder 'resources' is needed");

  std::string path = location;
  const size_t colon = location.find(':');
  if (lower(location.substr(0, 5)) == "file:") {
    path = location.substr(5);
    if (path.rfind("//", 0) == 0 && !is_drive(path, 2)) {
      const size_t end = std::min(path.find('/', 2), path.size());
      const std::string host = lower(path.substr(2, end - 2));
      if (!host.empty() && host != "localhost") refuse("is on another host: only local files");
      path = path.substr(end);
    } else if (path.rfind("//", 0) == 0) {
      path = path.substr(2);  // file://C:/dir: wrong, but used by importers
    }
    path = percent_decode(path);
    if (path[0] == '/' && is_drive(path, 1)) path = path.substr(1);
    if (is_drive(path, 0)) path[1] = ':';
  } else if (colon != std::string::npos && location.compare(colon, 3, "://") == 0) {
    refuse("is not a file URI: only files can be read");
  }
  if (path.find('\0') != std::string::npos) refuse("contains a zero byte");
  while (path.size() > 1 && (path.back() == '/' || path.back() == '\\')) path.pop_back();
  if (path.empty()) refuse("names no folder");
  return path;
}

}  // namespace dockloop
