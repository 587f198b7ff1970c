// trex merge A.exr B.exr ... -o OUT.exr: one picture of renders with different seeds.
#include <fmt/format.h>

#include <memory>

#include "src/app/app.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/frame/picture_merge.h"
#include "src/frame/picture_reader.h"

namespace trex {
namespace {

struct MergeArguments {
  std::vector<std::string> inputs;
  std::string output;
};

void merge(const MergeArguments& a) {
  if (a.inputs.size() < 2) fail(ExitCode::kUsage, "merge: want two pictures or more");
  if (!a.output.ends_with(".exr")) {
    fail(ExitCode::kUsage, "-o {}: a merged picture keeps its layers; use .exr", a.output);
  }
  checkWritable(a.output);
  PictureMerger merger;
  for (const std::string& input : a.inputs) merger.add(readPicture(input), input);
  writePicture(a.output, merger.result(), ToneMap{});
  fmt::print("{}\n", a.output);
}

}  // namespace

void addMergeCommand(CLI::App& app) {
  auto a = std::make_shared<MergeArguments>();
  CLI::App* c = app.add_subcommand("merge", "Merge renders of one view with different seeds");
  c->add_option("PICTURES", a->inputs,
                "Pictures (.exr) rendered with --aov variance,sampleCount and different --seed")
      ->required();
  c->add_option("-o,--output", a->output, "The merged picture (.exr)")->required();
  c->callback([a] { merge(*a); });
}

}  // namespace trex
