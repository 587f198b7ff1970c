// The machines that mpirun started beside a window.
#pragma once

#include <memory>
#include <vector>

#include "src/app/view/view_arguments.h"
#include "src/machines/servers.h"

namespace trex {

/// Null if this process is alone. Throws Error.
std::unique_ptr<machines::Servers> startServers();
/// Says what the window shows, whose sizes are set.
void welcomeServers(machines::Servers& servers, const ViewArguments& a,
                    const std::vector<std::string>& arguments);

}  // namespace trex
