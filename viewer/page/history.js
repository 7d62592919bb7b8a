// The frames of the last 30 s, so that a user can pause the view and step back.
const kMs = 30000;

/// Applies frames to a view, and undoes them. A mesh frame is undone by the rows that it has replaced, which `view`
/// returns. While the history is at its end, new frames are applied at once; otherwise they wait.
export class History {
  /// `view`: {apply(entry): applies its frame, and may store in the entry what `undo` needs; undo(entry)}
  constructor(view) {
    this.view = view;
    this.clear();
  }

  clear() {
    this.entries = [];  // {ms, frame, ...}
    this.at = 0;        // number of applied entries
    this.isLive = true;
  }

  add(frame, ms) {
    this.entries.push({ ms, frame });
    if (this.isLive) this.moveTo(this.entries.length);
    let oldest = this.at;  // a paused view moves on when its state is too old, because memory is limited
    while (oldest < this.entries.length && ms - this.entries[oldest].ms > kMs) ++oldest;
    if (oldest > this.at) this.moveTo(oldest);
    let old = 0;
    while (old < this.at - 1 && ms - this.entries[old].ms > kMs) ++old;  // the newest applied entry states the time
    // In steps, because each step moves all other entries.
    if (old < 256) return;
    this.entries.splice(0, old);
    this.at -= old;
  }

  /// Shows the state `ago` ms before `nowMs`, or the oldest stored state if that is newer. 0: shows the newest state, and
  /// from then on every new frame.
  show(ago, nowMs) {
    this.isLive = ago === 0;
    if (this.isLive) return this.moveTo(this.entries.length);
    let number = this.at;
    while (number < this.entries.length && this.entries[number].ms <= nowMs - ago) ++number;
    while (number > 0 && this.entries[number - 1].ms > nowMs - ago) --number;
    this.moveTo(number);
  }

  /// Time of the shown state, or null without frames.
  shownMs() { return this.at > 0 ? this.entries[this.at - 1].ms : null; }

  moveTo(number) {
    while (this.at < number) this.view.apply(this.entries[this.at++]);
    while (this.at > number) this.view.undo(this.entries[--this.at]);
    // A frame of probes replaces all of them, so it needs no undo, but the newest applied one has to be shown.
    for (let i = number - 1; i >= 0; --i)
      if (this.entries[i].frame.probes) return this.view.showProbes(this.entries[i].frame);
  }
}
