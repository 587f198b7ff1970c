// The machines that mpirun started beside a window.
#pragma once

#include <memory>
#include <vector>

#include "src/app/view/view_arguments.h"
#include "src/machines/servers.h"

namespace trex {

/// Null if this process is alone. Throws Error.
std::unique_ptr<machines::Servers> startServers();
/// Says what the window shows, whose sizes are set. Where it names no model that is one of another
/// machine, which `a` gets. Throws Error.
void welcomeServers(machines::Servers& servers, ViewArguments& a,
                    const std::vector<std::string>& arguments);

}  // namespace trex
