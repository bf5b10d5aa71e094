-- where each run of each study ended, and the main runs of the same task, scheme and misalignment beside it
WITH member (study, name, main) AS (VALUES ('buffer', 'laptop-buffer-relabel', false), ('buffer', 'laptop-buffer-empty', false), ('buffer', 'laptop', true), ('networks', 'laptop-networks-critics', false), ('networks', 'laptop-networks-all', false), ('networks', 'laptop', true), ('switch', 'laptop-switch-50', false), ('switch', 'laptop', true), ('touch', 'laptop-touch-pads', false), ('touch', 'laptop-touch-none', false), ('touch', 'laptop', true), ('ceiling', 'laptop-ceiling-estimate', false), ('ceiling', 'laptop', true)),
candidate AS (SELECT * FROM runs JOIN member USING (name) WHERE (run IN ('laptop/lift-oracle-orbit00-seed2', 'laptop/reach-dense2sparse-orbit10-seed0', 'laptop/reach-dense2sparse-orbit10-seed1', 'laptop/reach-dense2sparse-orbit10-seed2') OR name IN ('laptop-buffer-empty', 'laptop-buffer-relabel', 'laptop-ceiling-estimate', 'laptop-networks-all', 'laptop-networks-critics', 'laptop-switch-50', 'laptop-touch-none', 'laptop-touch-pads'))),
setting AS (
    SELECT DISTINCT study, task, scheme, misalignment_kind, misalignment_deg FROM candidate WHERE NOT main
)
SELECT c.study, c.main, c.run, c.name, c.task, c.misalignment_kind, c.misalignment_deg, c.scheme, c.seed,
       c.status, o.split, o.after_episode, o.episodes,
       o.mean_return, o.success_rate, o.mean_steps_to_success, o.mean_estimation_error, c.config
FROM candidate AS c
JOIN setting USING (study, task, scheme, misalignment_kind, misalignment_deg)
LEFT JOIN outcomes() AS o ON o.run = c.run
ORDER BY c.study, c.main, c.run
