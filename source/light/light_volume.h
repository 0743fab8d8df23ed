// Computes the light volume of a scene, once, before its rays are traced. Private to source.
#pragma once

#include <optional>
#include <string>

#include "slf/error.h"
#include "slf/light.h"
#include "slf/progress.h"
#include "source/light/illumination.h"
#include "source/light/light_filter.h"
#include "source/light/light_grid.h"
#include "source/medium/medium.h"

namespace slf {

/// The grid of a scene's light volume, without nodes: it covers the visible box, within the
/// options' memory.
[[nodiscard]] LightGrid plan_light(const RayGrid& grid, const Illumination& illumination,
                                   const LightOptions& options);

/// Computes the light at the nodes around all that a view can show, or at some of them: the result
/// at a node does not depend on which others were computed. The arguments must outlive it.
/// Thread-safety: none.
///
/// A node stands for the matter around it: up to 32 points within half a spacing, weighted by their
/// extinction and by how much of them can be seen from outside. Points that weigh little are
/// thinned out at random.
///
/// A node holds an ArrivingLight. Rays add the normal, the surface and the albedo of their samples,
/// which change within a voxel.
///
/// Lights: four of the points, chosen in proportion to what they scatter, march towards each of the
/// first three lights to tell which share of it arrives. Further lights count as surroundings.
///
/// Surroundings and scattered light: `samples` paths that start at the points, with next-event
/// estimation towards one light per vertex and, if the environment is peaked, towards the
/// environment (multiple importance sampling, Veach 1995). First directions follow the
/// low-discrepancy sequence R3 (Roberts 2018), shifted at random per node. A first pass with a
/// sixteenth of the paths gives an estimate of all light. In the second pass, a path that scatters
/// more than two nodes' spacing away ends with the estimate of that place, as in final gathering
/// (Reichert 1992). So light that scatters often may do so a few times more than `bounces` says.
///
/// Filter: a joint bilateral one over 3×3×3 nodes, twice for scattered light. It averages along
/// surfaces, not through them, because neighbours count less the more their normal and their depth
/// below the surface differ.
///
/// Surfaces: nodes take from those above and below them what shows more of the surface. Then they
/// are changed so that rays, which look up light beside the matter (kLookUpBeside), find the means
/// over the points, as in least-squares vertex baking (Kavan, Bargteil, Sloan 2011).
///
/// Deep nodes, which views hardly show, get fewer paths and marches: in proportion to exp(-d/2) at
/// an optical depth d. Matter deeper than 7 is left dark.
///
/// Some nodes: a node depends on those within kFilterReach of it, and, through paths, on estimates
/// elsewhere. Which ones, paths tell: nodes whose paths missed any are solved again.
///
/// The result depends on the scene and the options, not on `threads` (0: all).
class LightComputer {
 public:
  /// `plan`: a grid without nodes that covers the visible box, as plan_light() makes it.
  LightComputer(const Medium& medium, const Illumination& illumination, const LightOptions& options,
                LightGrid plan, unsigned threads);
  LightComputer(const LightComputer&) = delete;
  LightComputer& operator=(const LightComputer&) = delete;

  /// Finds the nodes. Call it once, first. Errors as parallel_for().
  [[nodiscard]] Result<void> prepare();
  /// The numbers of all nodes that can have light.
  [[nodiscard]] const std::vector<std::size_t>& nodes() const { return numbers_; }
  /// Their optical depths below what can be seen, and those of all others.
  [[nodiscard]] const std::vector<float>& depth() const { return depth_; }
  /// A grid in which they are missing, and all others are dark.
  [[nodiscard]] const LightGrid& blank() const { return blank_; }
  /// `numbers`, and the nodes up to `reach` places away along chains of neighbours.
  [[nodiscard]] std::vector<std::size_t> spread(std::vector<std::size_t> numbers, int reach) const;
  /// Sets those of the nodes `wanted`, a subset of nodes(), that are missing in `light`. Progress
  /// counts paths, and other work by the paths that would take as long. cancelled: stopped by
  /// `progress`.
  [[nodiscard]] Result<void> compute(LightGrid& light, const std::vector<std::size_t>& wanted,
                                     const ProgressCallback& progress);

  /// How light that is not direct is computed.
  struct Pass {
    std::uint32_t paths;        ///< per node
    std::uint32_t bounces;      ///< at most
    const LightGrid* estimate;  ///< null in the first pass; ends paths that are far from their node

    [[nodiscard]] std::size_t number() const { return estimate ? 1 : 0; }
  };

 private:
  [[nodiscard]] Result<void> fill(LightGrid& light, const Pass& pass,
                                  std::vector<std::size_t> wanted, Reporter& progress);
  [[nodiscard]] Result<void> solve(std::vector<std::size_t> numbers, const Pass& pass,
                                   Reporter& progress);

  const Medium& medium_;
  const Illumination& illumination_;
  const LightOptions& options_;
  unsigned threads_;
  LightGrid blank_, estimate_;         // what the first pass found
  std::optional<MissedNodes> missed_;  // of the estimate
  std::vector<float> depth_;
  std::vector<std::size_t> numbers_;
  std::vector<std::uint32_t> index_, near_;  // in `nodes_`; among those that are filtered
  std::vector<NodeLight> nodes_;
  std::vector<Pass> passes_;
};

/// All nodes. Errors as LightComputer.
[[nodiscard]] Result<LightGrid> compute_light(const Medium& medium,
                                              const Illumination& illumination,
                                              const LightOptions& options, unsigned threads,
                                              const ProgressCallback& progress);

}  // namespace slf
