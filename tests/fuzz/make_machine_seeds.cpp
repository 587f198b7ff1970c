// Writes a message of each kind, where the fuzzing of messages starts. Usage: fuzz_machine_seeds
// FOLDER
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

#include "src/machines/messages.h"
#include "src/machines/sample_bytes.h"
#include "src/machines/server.h"

namespace {

namespace fs = std::filesystem;
using namespace trex::machines;

fs::path folder_;

template <class M>
void write(const std::string& name, const M& message, std::uint32_t contents = 0,
           std::size_t count = 0) {
  const Bytes bytes = encode(message);
  std::ofstream file(folder_ / name, std::ios::binary);
  file.put(static_cast<char>(contents)).put(static_cast<char>(count));
  file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<long>(bytes.size()));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: fuzz_machine_seeds FOLDER\n");
    return 2;
  }
  folder_ = fs::path(argv[1]) / "machines";
  fs::create_directories(folder_);
  write("hello", Hello{"0.1.0", "host", 1, 2, 3});
  write("hello_model", Hello{"0.1.0", "host", 1, 2, 3, "/models/a.trex", 123456, 77});
  write("welcome", Welcome{0, 1, {5, 0, 7, 0}});
  write("welcome_elsewhere", Welcome{0, 1, {5, 0}, 1, 2, "/models/a.trex"});
  write("ready", Ready{5, 1});
  write("view", SetView{1});
  write("set", ViewSet{1, "none"});
  write("light", LightComes{1, 4096});
  write("pass", Pass{1, 2, 4096, 0.5, kPairs | kRays, {0.25, 0.5, 1.0}});
  write("job", GiveJob{2, 3, 64, 72});
  write("fetch", Fetch{1, {{65536, 0, 4096}, {131072, 0, 512}}});
  write("part", Part{1, Bytes(40, std::byte{3})});
  write("no_part", NoPart{1, 3, "a.trex, byte 4096: can't be read"});
  trex::ShotPhotons photons;
  photons.records = {{glm::vec3(1.0f), 7, glm::vec3(2.0f), 300},
                     {glm::vec3(3.0f), 8, glm::vec3(0.5f), 301}};
  photons.turns = {0, 3};
  photons.lessons = {{glm::vec4(0.5f), 1.0f, 2.0f, 0}};
  write("at_photons", AtPhotons{1, 256, 512});
  write("shoot", ShootPhotons{1, 2, 256, 256, 512});
  write("shot", Shot{1, 2, 256, 256, 512, 0.5, photons});
  write("photons", Photons{1, 0, 256, 256, 512, 0.0, photons});
  write("alone", ShootAlone{1, 256});
  write("failed", Failed{4, "no memory"});
  write("probe", Probe{1, Bytes(16)});
  write("probed", Probed{1});
  write("link", LinkFound{1e-4, 1.25e8});
  write("homes", Homes{{{1, kWholeWeight}, {3, kWholeWeight / 2}}});
  write("stop", Stop{});
  write("end", End{});
  write("lit", Lit{1, 4096});
  write("no_loan", NoLoan{2});
  write("serve", Serve{640, 360, trex::machines::joinArguments({"a.trex", "--spp", "4"})});
  write("edit", Edit{1, 640, 360, R"({"trex": 1, "edits_of": ""})"});
  write("aim", Aim{1, 4096, 77, R"({"trex": 1, "edits_of": "", "light": {"photons": 4096}})", 1});
  write("lent",
        Lent{1, 2, 1, 4096, 0.5, kPairs | kRays, {{0, 0, 16, 64}, {3, 1, 0, 1}}, {0.0, 0.5}});
  std::vector<trex::TakenSample> samples(5);
  samples[1].paired = samples[4].paired = true;
  for (const std::uint32_t contents : {0u, 1u, 33u, 62u, 63u, 127u, 255u}) {
    Result result;
    result.samples = packSamples(samples, contents, contents % 2 != 0);
    write("result" + std::to_string(contents), result, contents, samples.size());
  }
}
