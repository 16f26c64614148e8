/** Refreshes between flips, as `study_app/pacing.py` counts them. */
const LATE_SHARE = 0.15;
const FOLLOW_SHARE = 0.1;

/** Counts the refreshes of each flip on their grid. */
export class Pacer {
  private readonly period_s: number;
  private line_s: number | null = null; // grid line of the flip before

  constructor(refresh_hz: number) {
    this.period_s = 1 / refresh_hz;
  }

  /** Refreshes since the flip before: 1 in time; 0 for the first, and for one too soon. */
  flip(t_s: number): number {
    if (this.line_s === null) {
      this.line_s = t_s;
      return 0;
    }
    const since = (t_s - this.line_s) / this.period_s;
    const refreshes = roundHalfEven(since);
    if (refreshes < 0) throw new Error(`flip stamps must not run backwards (got ${t_s} s)`);
    const behind = since - refreshes;
    this.line_s += refreshes * this.period_s;
    const late = behind >= LATE_SHARE;
    if (!late && refreshes) this.line_s += behind * this.period_s * FOLLOW_SHARE;
    return refreshes;
  }
}

/** The nearest whole number, of two as near the even one, as Python rounds. */
function roundHalfEven(value: number): number {
  const down = Math.floor(value);
  const rest = value - down;
  const up = rest > 0.5 || (rest === 0.5 && down % 2 !== 0);
  return up ? down + 1 : down;
}
