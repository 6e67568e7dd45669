"""The mechanism of the paper: parameters, geometry, kinematics, dynamics, linear model, slews.  Knows nothing of FMI.

Equation numbers are those of H. Zhang et al., Appl. Sci. 2023, 13(4), 2188.  The paper has slips.  The code follows the
right form, which was checked against a nonlinear multibody model.  The files named here hold the equations::

    (5)              the second vector is q_b = (t_b, theta_b)
    (8), (11)        plus on the base term: dq_p = J_pl dd + J_pb dq_b               kinematics, dynamics
    (16)             its first line lacks - l_f0                                     kinematics
    (20), (23)       I_p and I_b are about the frame's origin                        dynamics
    (22)             1/2 on the block form, M_b21 on its lower left                  dynamics
    (29), (30)       minus on the modal term                                         theory/transfer_matrices
    (39)             [0 E] in axes of B, [0 R^T] in axes of P                        kinematics, linear_model
    (41), (42)       the estimate (42) ignores the resonances of the bus modes       theory/transfer_matrices
    (43), (44)       U12 Y in place of Y U21                                         theory/transfer_matrices
    (51)-(55)        (52) multiplies acceleration and (54) displacement              control/feedforward
    (A11)            divide by the leg's length, coarse legs as well                 dynamics
    (A17)-(A25)      a coarse leg is two parts, taken at its current length          dynamics
    Algorithm 1      converges for mu < 2/lambda_max(J J^T), about 0.81              inverse_kinematics

Parts of legs have no moment of inertia about the leg's axis.  So (A6), by which a leg turns about its axis with the
base, makes no difference.
"""
