-- last evaluation before the switch against the last one of training; `dense` over the same episodes is the control
WITH curve AS (
    SELECT *, split_part(run, '/', 1) AS name FROM evaluations WHERE split = 'eval' AND run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
), switched AS (
    SELECT name, task, misalignment_kind, misalignment_deg, seed,
           max(after_episode) FILTER (WHERE phase <> 'sparse') AS before_episode,
           max(after_episode) FILTER (WHERE phase = 'sparse') AS after_episode
    FROM curve WHERE scheme = 'dense2sparse'
    GROUP BY ALL
    HAVING before_episode IS NOT NULL AND after_episode IS NOT NULL
), ends AS (
    SELECT s.*, c.scheme,
           max(c.mean_return) FILTER (WHERE c.after_episode = s.before_episode) AS before_return,
           max(c.mean_return) FILTER (WHERE c.after_episode = s.after_episode) AS after_return
    FROM switched AS s JOIN curve AS c USING (name, task, misalignment_kind, misalignment_deg, seed)
    WHERE c.scheme IN ('dense', 'dense2sparse')
    GROUP BY ALL
)
SELECT *, after_return - before_return AS change
FROM ends
ORDER BY name, task, misalignment_kind, misalignment_deg, scheme, seed
