// Text inside of XML and HTML.
#pragma once

#include <string>

namespace trex {

/// Text for XML and HTML: & < > " ' are replaced.
std::string escaped(const std::string& text);

}  // namespace trex
