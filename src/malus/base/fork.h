// Processes made by fork, which have one thread: the caller's.
#pragma once

namespace malus {

/// For a process that was just forked, perhaps while other threads of its parent worked:
/// parallel_for then stays on the calling thread and away from oneTBB, whose locks those threads
/// may have held, until set_thread_count asks for other than one thread.
void work_alone(bool alone = true);

/// Whether that was said last.
bool works_alone();

}  // namespace malus
