// Mosaic <-> packed planes, one plane per site of the layout's cell.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <string>
#include <vector>

namespace malus {

/// Rows (or columns) of the packed planes of a mosaic: ceil(size / cell).
int packed_size(int mosaic_size, int cell_size);

/// Packs any size, from any phase of the cell on: where the mosaic begins or ends inside a cell the
/// missing samples repeat the channel's first or last one. Result: layout.channels() planes of
/// packed_size(phase.row + rows) x packed_size(phase.col + cols). A channel with no sample at all
/// (a mosaic smaller than one cell) takes the mosaic's last row or column.
Planes pack(View<const float> mosaic, const SensorLayout& layout, CellPhase phase = {});

/// One of those planes, of a mosaic from the cell's first pixel on.
Image pack_channel(View<const float> mosaic, const SensorLayout& layout, int channel);

/// The inverse: writes every mosaic pixel from its channel's plane. Contract: the planes have the
/// packed size.
void unpack(const Planes& planes, const SensorLayout& layout, View<float> mosaic,
            CellPhase phase = {});

/// Names of the packed planes: those of the channels, told apart where a cell has several sites of
/// one name ("0", "0_2", "0_3").
std::vector<std::string> plane_names(const SensorLayout& layout);

/// Throws InputError, naming the source, where a mosaic is smaller than one cell: some channels
/// have no sample of their own, so what compares channels, as polarization does, has no meaning.
void require_whole_cell(View<const float> mosaic, const SensorLayout& layout,
                        const std::string& source);

}  // namespace malus
