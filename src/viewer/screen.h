// What the screen shows of a session, brought up to date within what is left of a step.
#pragma once

#include <functional>
#include <optional>

#include "src/session/session.h"
#include "src/viewer/viewer.h"

namespace trex {

class Screen {
 public:
  /// The frame begins anew: what is shown next is of another generation. `hold`: keep the picture
  /// until the new one has every second pixel (the light has come), or every fourth where looks
  /// know what pixels show; else show the coarsest at once.
  void restart(bool hold);
  /// Takes over the frame as it is, if the next picture of it is due. Before samples are taken, so
  /// that they get what this leaves of a step: milliseconds, in one piece.
  void prepare(const Session& session, const ViewState& state);
  /// Works until the screen is up to date or nothing is left of the step: left() is in seconds.
  /// True if the picture has changed. `exact`: the session of the right half, or null.
  bool update(const Session& session, const Session* exact, const Look& look,
              const ViewState& state, const std::function<double()>& left);
  const ScreenImage& image() const { return image_; }
  /// What the image shows, before it was tone-mapped; empty before there is an image.
  const std::vector<vec3>& linear() const { return linear_; }
  /// The picture of this generation is on the screen, in whatever quality.
  bool showsGeneration() const { return shown_; }
  /// Nothing more can be shown of the frame as it is.
  bool complete(const Session& session, const Session* exact, const ViewState& state) const;
  std::uint32_t spacing() const { return spacing_; }
  /// A picture is under way that takes more than one step.
  bool filtering() const { return job_.has_value(); }
  /// It only has to be put on the screen, which the next update does, in one piece.
  bool ready() const { return ready_; }
  /// What that takes, about.
  double finishSeconds() const { return finishSeconds_; }

 private:
  void start(const Session& session);
  bool beauty(const Session& session, const std::function<double()>& left);
  void dropJob();
  bool values(const Session& session, const ViewState& state);
  bool inspect(const Session& session, const ViewState& state,
               const std::function<bool()>& keepGoing);
  void paint(const Session& session, const Session* exact, const Look& look,
             const ViewState& state);

  ScreenImage image_;
  std::vector<vec3> linear_;  ///< beauty, or the values of another view
  std::optional<ShownPicture> job_;
  std::uint32_t jobSpacing_ = 0, spacing_ = 0;  ///< of the picture under way, and shown
  std::uint32_t jobLattice_ = 0, lattice_ = 0;  ///< likewise of the pixels that its light is of
  bool jobSpread_ = false, spread_ = false;     ///< and whether that is spread
  double jobProgress_ = 0.0, progress_ = 0.0, exactProgress_ = 0.0;
  bool hold_ = false, shown_ = false, ready_ = false;
  double finishSeconds_ = 0.004, finishing_ = 0.0;  ///< the latter of the picture under way
  std::uint32_t inspectedCells_ = 0;
  // What was painted.
  ViewState painted_;
  float exposure_ = 0.0f;
  bool isPainted_ = false;
};

}  // namespace trex
