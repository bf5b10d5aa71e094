"""How the final episodes end: whether the task is done at the last step, and where that is lost."""

MEANINGS = {
    "kept": "done at the last step and in at least 19 of 20 steps since it first was",
    "regained": "done at the last step, but in fewer",
    "lost": "done at some step, not at the last",
    "never": "done at no step",
    "fallen": "whatever was done, the cube ends more than 5 cm below where it began, off the table",
}
"""Of every ending, in the order of the tables. One whose cube has fallen is of no other."""

NOTE = (
    "Share of the final episodes of all seeds, in brackets their mean episode reward. "
    + "; ".join(f"{ending}: {meaning}" for ending, meaning in MEANINGS.items())
    + ". Done is, by each run's own settings, touch or 3 cm in reach and lifted in lift."
)
"""What a table of them says."""

_COLUMNS = ",\n       ".join(
    f"count(*) FILTER (WHERE ending = '{ending}') AS {ending}, "
    f"avg(return) FILTER (WHERE ending = '{ending}') AS {ending}_return"
    for ending in MEANINGS
)

ENDINGS = f"""
-- how final episodes end, by whether the task is done at the last step (reach: touch or 3 cm; lift: lifted): kept (and
-- done in 19 of 20 steps since it first was), regained, lost, never; fallen: whatever was done, the cube ends off the
-- table
WITH episode AS (
    SELECT run, task, misalignment_kind, misalignment_deg, scheme, episode, sum(reward_dense_true) AS return,
           arg_max(success, step) AS is_done, count(*) FILTER (WHERE success) AS done,
           min(step) FILTER (WHERE success) AS first_done, max(step) AS last_step,
           arg_max(cube_true_z, step) - arg_min(cube_true_z, step) AS rise
    FROM transitions
    WHERE split = 'final' AND {{runs}}
    GROUP BY ALL
), ended AS (
    SELECT *, CASE WHEN rise < -0.05 THEN 'fallen'
                   WHEN done = 0 THEN 'never'
                   WHEN NOT is_done THEN 'lost'
                   WHEN done >= 0.95 * (last_step + 1 - first_done) THEN 'kept'
                   ELSE 'regained' END AS ending
    FROM episode
)
SELECT split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme, count(*) AS episodes,
       {_COLUMNS}
FROM ended
GROUP BY ALL
ORDER BY ALL
"""
