#include "malus/calibrate/internal/bias_frames.h"

namespace malus {

void BiasFrames::add(FrameComponents&& frame) {
  std::vector<double> sum(frame.mean_dn.size());
  for (std::size_t c = 0; c < sum.size(); ++c)
    sum[c] = frame.pixel_variance_dn2[c] + frame.row_variance_dn2[c] + frame.column_variance_dn2[c];
  mean.push_back(std::move(frame.mean_dn));
  pixel.push_back(std::move(frame.pixel_variance_dn2));
  row.push_back(std::move(frame.row_variance_dn2));
  column.push_back(std::move(frame.column_variance_dn2));
  total.push_back(std::move(sum));
  row_offset.push_back(std::move(frame.row_offset_dn));
  residuals.push_back(std::move(frame.residuals));
  above.push_back(std::move(frame.residuals_above));
}

std::vector<double> mean_over_frames(const FrameSeries& series) {
  std::vector<double> mean(series.front().size(), 0.0);
  for (const auto& frame : series)
    for (std::size_t c = 0; c < mean.size(); ++c)
      mean[c] += frame[c] / static_cast<double>(series.size());
  return mean;
}

}  // namespace malus
